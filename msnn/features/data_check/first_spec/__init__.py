"""Makes a spec out of a file of measured data: what `msnn init NAME --data FILE` writes."""
