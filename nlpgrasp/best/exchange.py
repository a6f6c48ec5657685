"""One contact at a time to the best of many places: grasps on surfaces that are too rough to climb."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.best.climb import Climber
from nlpgrasp.best.spots import Reach, Spot
from nlpgrasp.common.validation import FloatArray

SPREAD, LATEST, ADDED = 60, 80, 8  # directions: well-spread ones, the latest weak ones, of which a round adds some
ROUNDS = 25
COUNT = 5000  # places of a contact
LIKELY = 1000  # places, of those that seem best along the latest directions, that are tried along all
MOST = 1e37  # of a support's power, whose sums are short floats still: along a twist that the task hardly works along
MODEL = 1e-3  # relative: where the known directions and all directions agree on a placement's value


class Places:
    """Many places of contacts that are alike, and their supports along a growing list of directions.

    Parameters
    ----------
    pieces : Reach
    count : int
        About how many on each face.
    """

    def __init__(self, pieces: Reach, count: int) -> None:
        self.pieces = pieces
        points, normals, owner = [], [], []
        self.surfaces = tuple(dict.fromkeys(pieces.surfaces))
        for i, surface in enumerate(self.surfaces):
            found = surface.places(count)
            kept = pieces.allowed.each(*found)
            points.append(found[0][kept])
            normals.append(found[1][kept])
            owner.append(np.full(int(np.sum(kept)), i))
        self.points, self.normals, self.owner = (np.concatenate(parts) for parts in (points, normals, owner))
        self.maps = pieces.supports.maps_at(self.points, self.normals)

    def powers(self, twists: FloatArray) -> FloatArray:
        """Return supports along twists (m, d) to the measure's power, (m, places)."""
        flat = self.maps.transpose(1, 0, 2).reshape(self.maps.shape[1], -1)
        z = (twists @ flat).reshape(len(twists), *self.maps.shape[::2])
        return _powers(self.pieces.supports, z).astype(np.float32)

    def near(self, spot: Spot) -> Spot:
        """Return the place that is nearest to a spot."""
        return self.spot(int(np.argmin(np.linalg.norm(self.points - spot.point, axis=1))))

    def drawn(self, rng: np.random.Generator) -> Spot:
        """Return one of them at random."""
        return self.spot(int(rng.integers(len(self.points))))

    def spot(self, place: int) -> Spot:
        """Return one of them as a spot."""
        return Spot(self.pieces, self.surfaces[int(self.owner[place])], self.points[place], self.normals[place])


class Exchange:
    """Raises mu of grasps by moves of one contact at a time to the best of all its places.

    Parameters
    ----------
    pieces : sequence of Reach
    climber : Climber
        Tells the weakest directions of a grasp.
    count : int
        Places of each contact, about.
    """

    def __init__(self, pieces: Sequence[Reach], climber: Climber, count: int) -> None:
        self.climber = climber
        self.places = [Places(p, count) for p in pieces]
        self.of_slot = [places for places in self.places for _ in places.pieces.slots]
        step = max(1, len(climber.twists) // SPREAD)
        self.spread = climber.twists[::step]
        self._spread_powers = [places.powers(self.spread) for places in self.places]
        self.forget()

    @classmethod
    def of(cls, pieces: Sequence[Reach], climber: Climber) -> Exchange | None:
        """Return one for contacts on rough faces, None where every face can be climbed on."""
        rough = all(surface.rough for p in pieces for surface in p.surfaces)
        return cls(pieces, climber, COUNT) if rough else None

    def forget(self) -> None:
        """Begin with the well-spread directions alone, as at first: what follows depends on no grasp before."""
        self.latest = self.spread[:0]
        self._latest_powers = [powers[:0] for powers in self._spread_powers]

    def allowed(self, spots: Sequence[Spot]) -> list[Spot]:
        """Return the spots, those that constraints do not permit replaced by the nearest of their places."""
        pairs = zip(spots, self.of_slot, strict=True)
        return [spot if spot.allowed or not len(places.points) else places.near(spot) for spot, places in pairs]

    def improved(self, spots: Sequence[Spot], twists: FloatArray) -> tuple[list[Spot], float]:
        """Return a grasp that no exchange of one contact betters, and what its mu seems to be.

        Parameters
        ----------
        spots : sequence of k Spot
        twists : (m, d) array
            Directions that are weak there.
        """
        best = list(spots)
        ((value, weak),) = self.climber.weakest([best], [twists])
        for _ in range(ROUNDS):
            self._add(weak[:ADDED])
            moved, hoped = self._exchanged(best)
            if hoped <= value * (1.0 + MODEL):
                break
            ((found, weak),) = self.climber.weakest([moved], [self.latest])
            if found > value:
                best, value = moved, found
        return best, value

    def drawn(self, rng: np.random.Generator) -> list[Spot]:
        """Return each contact at one of its places, at random."""
        return [own.drawn(rng) for own in self.of_slot]

    def again(
        self, spots: Sequence[Spot], value: float, rng: np.random.Generator, times: int
    ) -> tuple[Sequence[Spot], float]:
        """Return the best that exchanges lead to which begin again, some contacts at random places, and its value."""
        best = spots
        for _ in range(times):
            shaken = list(best)
            for i in rng.choice(len(best), rng.integers(1, max(2, len(best))), replace=False).tolist():
                shaken[i] = self.of_slot[i].drawn(rng)
            found, there = self.improved(shaken, self.latest)
            if there > value:
                best, value = found, there
        return best, value

    def _add(self, twists: FloatArray) -> None:
        self.latest = np.concatenate([twists, self.latest])[:LATEST]
        self._latest_powers = [
            np.concatenate([places.powers(twists), old])[:LATEST]
            for places, old in zip(self.places, self._latest_powers, strict=True)
        ]

    def _exchanged(self, spots: Sequence[Spot]) -> tuple[list[Spot], float]:
        """Return the spots after exchanges along the known directions, and the least support along these."""
        twists = np.concatenate([self.spread, self.latest])
        pairs = zip(self._spread_powers, self._latest_powers, strict=True)
        tables = dict(zip(self.places, pairs, strict=True))
        result = list(spots)
        own = np.stack([_powers_at(spot, twists) for spot in spots])
        value, since, i = float(np.min(np.sum(own, axis=0))), 0, 0
        while since < len(result):
            spread, latest = tables[self.of_slot[i]]
            rest = (np.sum(own, axis=0) - own[i]).astype(np.float32)[:, None]
            least = np.min(latest + rest[len(spread) :], axis=0)
            likely = np.argsort(-least)[:LIKELY]
            least = np.minimum(least[likely], np.min(spread[:, likely] + rest[: len(spread)], axis=0))
            chosen = int(likely[np.argmax(least)])
            since += 1
            if np.max(least) > value * (1.0 + MODEL):
                value, since = float(np.max(least)), 1
                own[i] = np.concatenate([spread[:, chosen], latest[:, chosen]])
                result[i] = self.of_slot[i].spot(chosen)
            i = (i + 1) % len(result)
        return result, value ** (1.0 / spots[0].pieces.supports.measure.power)


def _powers_at(spot: Spot, twists: FloatArray) -> FloatArray:
    """Return the support of one contact along twists (m, d) to the measure's power."""
    supports = spot.pieces.supports
    return _powers(supports, twists @ supports.maps_at(spot.point[None], spot.normal[None])[0])


def _powers(supports: Supports, z: FloatArray) -> FloatArray:
    """Return supports for force components z (..., n_i) to the measure's power, no larger than short floats take."""
    return np.minimum(supports.measure.support(supports.contact, z) ** supports.measure.power, MOST)
