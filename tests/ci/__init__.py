"""The action, the hooks and the sample repository of docs/ci.md, run as a code host runs them."""
