"""The browser preview of a plan."""
