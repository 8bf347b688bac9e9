"""Words of golden steps: draws them, and chooses words for which faulty programs fail."""
