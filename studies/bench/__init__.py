"""`bench`: error against processor time, what assembly costs beside a factorisation, and how far mesh motions carry."""
