"""Error for contacts that cannot balance each other."""

from __future__ import annotations

from collections.abc import Collection

from nlpgrasp.errors import InputError


class NoBalanceError(InputError):
    """Error: the contacts cannot all press at once in balance.

    Parameters
    ----------
    field, given, allowed : str
        As of ``InputError``.
    reason : str
        The reason as a clause.
    friction : float or None
        Sufficient friction coefficient, if all contacts have the same and more of it is enough.
    """

    def __init__(
        self, field: str, given: object, allowed: str, reason: str = "", friction: float | None = None
    ) -> None:
        super().__init__(field, given, allowed)
        self.reason, self.friction = reason, friction

    @classmethod
    def of(cls, idle: Collection[int], factor: float | None, frictions: Collection[float]) -> NoBalanceError:
        """Return the error for given idle contacts.

        Parameters
        ----------
        idle : collection of int
            Contacts without normal force in all balanced forces.
        factor : float or None
            Factor on friction with which all would press; None if no friction is enough.
        frictions : collection of float
            Distinct friction coefficients of the contacts.
        """
        named = f"contact{'s' if len(idle) > 1 else ''} {', '.join(map(str, idle))}"
        given = (
            f"{named} cannot press" if idle else "forces that press at every contact, but none that carry the wrench"
        )
        allowed = "a grasp whose contacts balance each other" if idle else "a wrench that these contacts exert"
        if factor is None:
            return cls("squeeze", given, allowed, given)
        larger, friction = f"friction at least {factor:.3g} times as large", None
        reason = f"{given}, but would with {larger}"
        if len(frictions) == 1:
            least = max(frictions)
            friction = factor * least
            larger += f" ({friction:.3g} in place of {least:.3g})"
            reason = f"{given} with friction {least:.3g}, but would with {friction:.3g}"
        return cls("squeeze", given, f"{larger}, or {allowed}", reason, friction)
