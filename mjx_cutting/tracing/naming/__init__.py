"""Which effects of a steady cut may be named: candidates, the tests they pass, the search over them."""
