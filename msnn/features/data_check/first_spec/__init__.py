"""Creates a spec from a file of measured data: `msnn init NAME --data FILE`."""
