"""One contact at a time to the best of many places: grasps on surfaces that are too rough to climb."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.best.climb import Climber
from nlpgrasp.best.spots import Reach, Spot
from nlpgrasp.common.validation import FloatArray

SPREAD, LATEST, ADDED = 60, 80, 8  # directions: well-spread ones, the latest weak ones, of which a round adds some
ROUNDS = 25
COUNT = 5000  # places of a contact
LIKELY = 300  # places, of those that seem best along the latest directions, that are tried along all
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
        maps = pieces.supports.maps_at(self.points, self.normals)
        self._parts = maps.shape[2]
        self._maps = maps.transpose(1, 0, 2).reshape(maps.shape[1], -1)

    def powers(self, twists: FloatArray) -> FloatArray:
        """Return supports along twists (m, d) to the measure's power, (m, places)."""
        z = (twists @ self._maps).reshape(len(twists), len(self.points), self._parts)
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


@dataclass
class Exchanged:
    """Where the exchanges of one grasp stand.

    Parameters
    ----------
    spots : list of k Spot
    value : float
        What its mu seems to be.
    weak : (m, d) array
        Directions that are weak where its contacts went last, weakest first.
    latest : (m, d) array
        Those of earlier rounds, the latest first.
    powers : list of (m, places) array
        Supports along these at all places of contacts that are alike, to the measure's power.
    """

    spots: list[Spot]
    value: float
    weak: FloatArray
    latest: FloatArray
    powers: list[FloatArray]


class Exchange:
    """Raises mu of grasps by moves of one contact at a time to the best of all its places.

    Parameters
    ----------
    places : sequence of Places
        Of the contacts, those that are alike together.
    climber : Climber
        Tells the weakest directions of a grasp.
    """

    def __init__(self, places: Sequence[Places], climber: Climber) -> None:
        self.climber, self.places = climber, places
        self.of_slot = [i for i, places in enumerate(self.places) for _ in places.pieces.slots]
        step = max(1, len(climber.twists) // SPREAD)
        self.spread = climber.twists[::step]
        self._spread_powers = [places.powers(self.spread) for places in self.places]

    @classmethod
    def of(cls, pieces: Sequence[Reach], climber: Climber) -> Exchange | None:
        """Return one for contacts on rough faces, None where every face can be climbed on."""
        rough = all(surface.rough for p in pieces for surface in p.surfaces)
        return cls([Places(p, COUNT) for p in pieces], climber) if rough else None

    def allowed(self, spots: Sequence[Spot]) -> list[Spot]:
        """Return the spots, those that constraints do not permit replaced by the nearest of their places."""
        pairs = [(spot, self.places[i]) for spot, i in zip(spots, self.of_slot, strict=True)]
        return [spot if spot.allowed or not len(places.points) else places.near(spot) for spot, places in pairs]

    def drawn(self, rng: np.random.Generator) -> list[Spot]:
        """Return each contact at one of its places, at random."""
        return [self.places[i].drawn(rng) for i in self.of_slot]

    def improved(self, grasps: Sequence[Sequence[Spot]], twists: Sequence[FloatArray]) -> list[Exchanged]:
        """Return, side by side, grasps that no exchange of one contact betters.

        Parameters
        ----------
        grasps : sequence of b sequences of k Spot
            Their contacts alike.
        twists : sequence of b (m, d) arrays
            Directions that are weak there.
        """
        none = self.spread[:0], [powers[:0] for powers in self._spread_powers]
        return self._improved([(list(spots), weak, *none) for spots, weak in zip(grasps, twists, strict=True)])

    def again(self, ended: Sequence[Exchanged], rng: np.random.Generator, times: int) -> list[Exchanged]:
        """Return the best that exchanges lead to which begin again from each grasp, some contacts at random places."""
        shaken = []
        for one in ended:
            for _ in range(times):
                spots = list(one.spots)
                for i in rng.choice(len(spots), rng.integers(1, max(2, len(spots))), replace=False).tolist():
                    spots[i] = self.places[self.of_slot[i]].drawn(rng)
                shaken.append((spots, one.latest, one.latest, one.powers))
        found = self._improved(shaken)
        each = [[one, *found[i * times : (i + 1) * times]] for i, one in enumerate(ended)]
        return [max(some, key=lambda one: one.value) for some in each]

    def _improved(
        self, begun: Sequence[tuple[list[Spot], FloatArray, FloatArray, list[FloatArray]]]
    ) -> list[Exchanged]:
        """Exchange contacts of grasps, of each the spots, directions weak there, and the memory it begins with."""
        if not begun:
            return []
        found = self.climber.weakest([spots for spots, *_ in begun], [weak for _, weak, *_ in begun])
        ended = [
            Exchanged(spots, value, weak, latest, powers)
            for (value, weak), (spots, _, latest, powers) in zip(found, begun, strict=True)
        ]
        going = ended
        for _ in range(ROUNDS):
            tried: list[tuple[Exchanged, list[Spot]]] = []
            for one in going:
                self._learn(one)
                moved, hoped = self._exchanged(one)
                if hoped > one.value * (1.0 + MODEL):
                    tried.append((one, moved))
            if not tried:
                break
            found = self.climber.weakest([moved for _, moved in tried], [one.latest for one, _ in tried])
            for (one, moved), (value, weak) in zip(tried, found, strict=True):
                one.weak = weak
                if value > one.value:
                    one.spots, one.value = moved, value
            going = [one for one, _ in tried]
        return ended

    def _learn(self, one: Exchanged) -> None:
        """Remember the weakest directions of a grasp."""
        new = one.weak[:ADDED]
        one.latest = np.concatenate([new, one.latest])[:LATEST]
        pairs = zip(self.places, one.powers, strict=True)
        one.powers = [np.concatenate([places.powers(new), old])[:LATEST] for places, old in pairs]

    def _exchanged(self, one: Exchanged) -> tuple[list[Spot], float]:
        """Return the spots after exchanges along the known directions, and the least support along these."""
        twists = np.concatenate([self.spread, one.latest])
        tables = list(zip(self._spread_powers, one.powers, strict=True))
        result = list(one.spots)
        own = np.stack([_powers_at(spot, twists) for spot in result])
        value, since, i = float(np.min(np.sum(own, axis=0))), 0, 0
        while since < len(result):
            spread, latest = tables[self.of_slot[i]]
            rest = (np.sum(own, axis=0) - own[i]).astype(np.float32)[:, None]
            least = np.min(latest + rest[len(spread) :], axis=0)
            likely = np.argpartition(least, -LIKELY)[-LIKELY:] if len(least) > LIKELY else np.arange(len(least))
            least = np.minimum(least[likely], np.min(spread[:, likely] + rest[: len(spread)], axis=0))
            chosen = int(likely[np.argmax(least)])
            since += 1
            if np.max(least) > value * (1.0 + MODEL):
                value, since = float(np.max(least)), 1
                own[i] = np.concatenate([spread[:, chosen], latest[:, chosen]])
                result[i] = self.places[self.of_slot[i]].spot(chosen)
            i = (i + 1) % len(result)
        return result, value ** (1.0 / one.spots[0].pieces.supports.measure.power)


def _powers_at(spot: Spot, twists: FloatArray) -> FloatArray:
    """Return the support of one contact along twists (m, d) to the measure's power."""
    supports = spot.pieces.supports
    return _powers(supports, twists @ supports.maps_at(spot.point[None], spot.normal[None])[0])


def _powers(supports: Supports, z: FloatArray) -> FloatArray:
    """Return supports for force components z (..., n_i) to the measure's power, no larger than short floats take."""
    return np.minimum(supports.measure.support(supports.contact, z) ** supports.measure.power, MOST)
