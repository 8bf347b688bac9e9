"""Creates projects, and inspects the installation."""
