"""The unsafe commands of docs/evidence/safety.md: each test fails once its code is broken."""
