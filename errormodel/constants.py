"""Constants that every part of the program takes from here."""

STANDARD_GRAVITY_M_S2 = 9.80665  # the 3rd CGPM, 1901
T_REF_C = 25.0  # reference temperature where none is given
