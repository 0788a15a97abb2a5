"""Instruments that are not there: the same bytes on real sockets and pseudo-terminals."""
