"""Studies: campaigns of identification on the wheelset FMU, from their description to their report."""
