"""Placeholder until the branch with the conversion is merged."""


def conversion(source: str, target: str) -> tuple[float, float] | None:
    """Return factor and offset."""
    return (1.0, 0.0) if (source or "1") == (target or "1") else None
