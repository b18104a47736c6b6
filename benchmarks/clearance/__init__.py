"""How near to zones and fences a vehicle really comes, beside what its mission promises."""
