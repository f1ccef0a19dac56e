"""Studies: campaigns of identification on the wheelset FMU, from the file that describes one to its report."""
