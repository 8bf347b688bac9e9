"""The Jinja2 text that the backends fill; a package so that the wheel carries it."""
