"""Does the judge of the rehearsal notice when the flight code is broken on purpose?"""
