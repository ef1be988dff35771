"""What several test files use; see tests/README.md."""
