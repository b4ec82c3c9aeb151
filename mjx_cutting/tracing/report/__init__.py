"""report.html: the finding in words and figures."""
