"""stub"""

from sinscal.run import RigRun


def checked_rig(run: RigRun) -> RigRun:
    """X."""
    return run
