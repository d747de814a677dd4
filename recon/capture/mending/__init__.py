"""A recording anew, with what the check found put right: instants and calibrations."""
