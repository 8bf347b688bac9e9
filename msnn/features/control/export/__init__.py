"""The target `mpc`: writes controllers and filters, and compares them with the reference."""
