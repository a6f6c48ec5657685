"""Why contacts do not press against each other."""

from __future__ import annotations

from collections.abc import Collection

from nlpgrasp.errors import InputError


class NoBalanceError(InputError):
    """Contacts that cannot all press at once in balance.

    Parameters
    ----------
    field, given, allowed : str
        As of ``InputError``.
    reason : str
        The same as a clause.
    friction : float or None
        The friction coefficient with which they would, where all contacts have the same and more of it would do.
    """

    def __init__(
        self, field: str, given: object, allowed: str, reason: str = "", friction: float | None = None
    ) -> None:
        super().__init__(field, given, allowed)
        self.reason, self.friction = reason, friction

    @classmethod
    def of(cls, idle: Collection[int], factor: float | None, frictions: Collection[float]) -> NoBalanceError:
        """Return the error of some contacts.

        Parameters
        ----------
        idle : collection of int
            Contacts that press in no balanced forces.
        factor : float or None
            Times the friction there is, with which all would press; None where no friction is enough.
        frictions : collection of float
            The friction coefficients of the contacts, each once.
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
