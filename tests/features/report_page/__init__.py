"""TODO tests/features/report_page."""
