"""The one way to move the vehicle: legs checked, commanded, and watched until they show."""
