"""Names of time zones, such as `Europe/Berlin`, from the database of the machine or of tzdata."""

from __future__ import annotations

from spec_schema.diagnostics.suggest import nearest

_OF_MACHINE = ("localtime", "posixrules", "Factory", "posix/", "right/")
"""Names that mean another zone on another machine, or count leap seconds."""


def is_zone(name: str) -> bool:
    """True for the name of a zone."""
    # loads in milliseconds, and few specs have zones
    from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

    if name.startswith(_OF_MACHINE):
        return False
    try:
        ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        return False
    return True


def near_zones(name: str) -> tuple[str, ...] | None:
    """Names of zones near a name: none, one or several; None if there is no database of zones."""
    from zoneinfo import available_timezones

    known = sorted(zone for zone in available_timezones() if not zone.startswith(_OF_MACHINE))
    if not known:
        return None
    city = name.replace(" ", "_").rpartition("/")[2].lower()
    of_city = [zone for zone in known if zone.rpartition("/")[2].lower() == city]
    if of_city:
        return tuple(of_city[:3])
    lower = {zone.lower(): zone for zone in known}
    near = nearest(name.replace(" ", "_").lower(), lower)
    if near is None:
        cities = {zone.rpartition("/")[2].lower(): zone for zone in known}
        near_city = nearest(city, cities)
        return () if near_city is None else (cities[near_city],)
    return (lower[near],)
