"""The unsafe commands of docs/safety.md: each test fails once its code is broken."""
