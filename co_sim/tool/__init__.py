"""Commands for any FMU and any SSP: what `wheelset simulate` and its relatives are made of."""
