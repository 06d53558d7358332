"""`bench`: error against seconds, what assembly costs beside a factorisation, and how far mesh motions carry."""
