"""For agents that import the template's messages and never use them."""
