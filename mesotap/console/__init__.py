"""The operator's console: a page in the browser that runs a session ([docs/console.md])."""
