"""Words of golden steps: draws them, and chooses those that a wrong program gets wrong."""
