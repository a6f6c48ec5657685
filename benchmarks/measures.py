"""Time and accuracy of quality measures and finger forces, against Clarabel and friction pyramids."""

import time

import clarabel
import numpy as np
from scipy import sparse

import nlpgrasp as ng
from benchmarks.starts import run_starts
from tests.quality.test_critical_friction import Case, contradictions
from tests.quality.test_robust_mu import LOSS, OFFSET
from tests.quality.test_robust_mu import Case as RobustCase
from tests.samples import closed_ellipsoid_grasp, ellipsoid_grasp

BALL = ng.TaskEllipsoid([1.0] * 6)


def timed(function):
    """Call a function, and return its result and the wall seconds."""
    start_time = time.perf_counter()
    result = function()
    return result, time.perf_counter() - start_time


def random_grasps(count=30):
    """Return random force-closed grasps by number of contacts."""
    rng = np.random.default_rng(0)
    return {k: [closed_ellipsoid_grasp(rng, k) for _ in range(count)] for k in (3, 4, 5)}


def optimal_grasps():
    """Return locally optimal grasps of an ellipsoid."""
    grasps = []
    for k in (3, 4, 5):
        problem = ng.GraspProblem(ng.Ellipsoid([2, 1, 1]), [ng.FrictionContact(0.5)] * k, BALL)
        grasps += [r.on_body.grasp for r in run_starts(problem, 2, rtol=0.5)[0]]
    return grasps


def certificates(grasps):
    """Print the time of certificates of mu, delta and nu."""
    for k, batch in grasps.items():
        for name, measure in (("mu", lambda g: ng.mu(g, BALL, 0.01)), ("delta", lambda g: ng.delta(g, 0.5))):
            runs = [timed(lambda g=g, m=measure: m(g)) for g in batch]
            seconds = [s for _, s in runs]
            gap = max(b.gap for b, _ in runs)
            print(
                f"{name}, {k} contacts, 1 %: median {1e3 * np.median(seconds):.0f} ms, most {1e3 * max(seconds):.0f} ms"
            )
            print(f"    widest gap {gap:.3%}")
    optimal = optimal_grasps()
    for name, measure in (("mu", lambda g: ng.mu(g, BALL, 0.01)), ("nu", lambda g: ng.nu(g))):
        seconds = [timed(lambda g=g, m=measure: m(g))[1] for g in optimal]
        print(f"{name} at optimal grasps, 1 %: median {np.median(seconds):.2f} s, most {max(seconds):.2f} s")
    seconds = [timed(lambda g=g: ng.nu(g))[1] for batch in grasps.values() for g in batch[:5]]
    print(f"nu at random grasps, 1 %: median {np.median(seconds):.2f} s, most {max(seconds):.2f} s")


def screening():
    """Print the time to screen 10,000 grasps for each budget."""
    rng = np.random.default_rng(0)
    grasps = [ellipsoid_grasp(rng, 4) for _ in range(10_000)]
    points, normals = (np.stack([getattr(g, n) for g in grasps]) for n in ("points", "normals"))
    stack = ng.GraspStack(points, normals, ng.FrictionContact(0.5))
    for budget in ("l2", "shared", "per_finger"):
        seconds = timed(lambda b=budget: ng.screen(stack, BALL, force_budget=b))[1]
        print(f"screening 10,000 grasps, {budget}: {seconds:.2f} s")


def conic_force(grasp, wrench, settings):
    """Return the least finger forces for one wrench by Clarabel, as a user would write the program."""
    n = grasp.G.shape[1]
    rows, cones = [grasp.G], [clarabel.ZeroConeT(6)]
    for i, contact in enumerate(grasp.contacts):
        block = np.zeros((3, n))
        block[0, 3 * i], block[1, 3 * i + 1], block[2, 3 * i + 2] = contact.friction, 1.0, 1.0
        rows.append(-block)
        cones.append(clarabel.SecondOrderConeT(3))
    A = sparse.csc_matrix(np.vstack(rows))
    b = np.concatenate([wrench, np.zeros(3 * len(grasp))])
    return np.array(clarabel.DefaultSolver(sparse.eye(n, format="csc"), np.zeros(n), A, b, cones, settings).solve().x)


def forces(grasps):
    """Print the time of finger forces for 10,000 wrenches against Clarabel."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10  # for equally small residuals
    wrenches = np.random.default_rng(1).standard_normal((10_000, 6))
    for grasp in grasps[4][:3]:
        result, seconds = min(
            (timed(lambda g=grasp: ng.finger_forces(g, wrenches)) for _ in range(3)), key=lambda r: r[1]
        )
        conic, loop = timed(lambda g=grasp: np.array([conic_force(g, w, settings) for w in wrenches[:500]]))
        loop *= len(wrenches) / 500
        residual = np.max(np.linalg.norm(result.forces @ grasp.G.T - wrenches, axis=1))
        difference = np.max(np.linalg.norm(conic - result.forces[:500], axis=1))
        print(
            f"10,000 wrenches: {seconds:.3f} s, worst residual {residual:.1e}; Clarabel {loop:.1f} s (from 500), "
            f"{loop / seconds:.0f} times as long; forces at most {difference:.1e} apart"
        )


def pyramids(grasps):
    """Print time and error of friction pyramids against certified cones."""

    def show(budget, rtol, k, edges):
        certified = [timed(lambda g=g: ng.delta(g, rtol=rtol, force_budget=budget)) for g in grasps[k][:8]]
        seconds = np.median([s for _, s in certified])
        for m in edges:
            runs = [timed(lambda g=g, m=m: ng.ferrari_canny(g, m, force_budget=budget)) for g in grasps[k][:8]]
            pyramid_seconds = np.median([s for _, s in runs])
            shortfall = np.median([1.0 - value / b.upper for (value, _), (b, _) in zip(runs, certified, strict=True)])
            print(
                f"{budget}, {k} contacts: certified to {rtol:.1%} in {1e3 * seconds:.1f} ms; {m}-edge pyramids "
                f"{1e3 * pyramid_seconds:.1f} ms, {shortfall:.1%} low: {pyramid_seconds / seconds:.1f} times as long"
            )

    for k in (3, 4, 5):
        show("shared", 0.005, k, (16, 32))
    for k in (3, 4, 5):
        show("per_finger", 0.01, k, (4,))


def friction(count):
    """Print time and width of critical frictions, and what conic programs beyond either end contradict."""
    seconds, widths, contradicted = [], [], 0
    for seed in range(count):
        case = Case.random(seed)
        start_time = time.process_time()
        found = ng.critical_friction(case.grasp, case.task, **case.limits)
        seconds.append(time.process_time() - start_time)
        if found.lower > 0.0 and np.isfinite(found.upper):
            widths.append(found.upper / found.lower - 1.0)
        for text in contradictions(case, found):
            contradicted += 1
            print(f"seed {seed}: {text}", flush=True)
    median, tenth, most = np.quantile(seconds, [0.5, 0.9, 1.0])
    print(f"critical friction of {count} grasps of 3 to 6 contacts, 2 %: CPU seconds {median:.2f} in the median,")
    print(f"    {tenth:.2f} for the slowest tenth, {most:.2f} at most; widest {max(widths):.2%}")
    print(f"    contradicted by conic programs: {contradicted}")


def support_ratios(case, points, frames, directions):
    """Return upper bounds on mu of displaced grasps (m,): support ratios along directions, from wrenches anew."""
    directions = directions / case.task.support(directions)[0][:, None]
    force, moment = directions[:, :3], directions[:, 3:]
    squares, supports = [], []
    for i, contact in enumerate(case.grasp.contacts):
        contact = contact.with_friction(1.0 - LOSS)
        arms = points[:, i] - case.grasp.torque_origin
        # work of a force f at p on a twist (force, moment): <f, force + moment x p>
        at_point = force[None] + np.cross(moment[None], arms[:, None])
        local = np.concatenate(
            [at_point @ frames[:, i], np.broadcast_to(moment, at_point.shape) @ frames[:, i]], axis=2
        )[..., list(contact.axes(3))]
        if case.budget in ("l2", "per_finger_size"):
            squares.append(np.sum(contact.project(local) ** 2, axis=2))
        else:
            supports.append(contact.extreme(local)[0])
    if case.budget == "l2":
        total = np.sqrt(np.sum(squares, axis=0))
    elif case.budget == "per_finger_size":
        total = np.sum(np.sqrt(squares), axis=0)
    else:
        total = np.max(supports, axis=0) if case.budget == "shared" else np.sum(supports, axis=0)
    return np.min(total, axis=1)


def robust(count, displaced, claimed):
    """Print the lower end of robust mu over the worst mu found, and random displaced grasps that are below it.

    Of the first ``claimed`` grasps also the share that an ordinary proof reaches.
    """
    shares, seconds, claims, below = [], [], [], 0
    for seed in range(count):
        case = RobustCase.random(seed)
        start_time = time.process_time()
        bounds = case.robust()
        seconds.append(time.process_time() - start_time)
        points, frames = case.displacements(displaced, np.random.default_rng(seed))
        worst, chosen, directions = bounds.upper, range(4), []
        for _ in range(3):  # along the weakest directions of the worst displaced grasps so far
            grasps = [case.displaced(points[j], frames[j]) for j in chosen]
            graded = [ng.mu(g, case.task, 0.1, force_budget=case.budget) for g in grasps]
            directions += [b.worst_direction for b in graded]
            ratios = support_ratios(case, points, frames, np.array(directions))
            worst, chosen = min(worst, np.min(ratios), *(b.upper for b in graded)), np.argsort(ratios)[:4]
        below += int(np.sum(ratios < bounds.lower))
        shares.append(bounds.lower / worst if worst > 0.0 else 1.0)
        if shares[-1] < 0.7:
            print(f"seed {seed}: lower end {bounds.lower:.3g}, worst found {worst:.3g}", flush=True)
        if seed < claimed:
            steps = np.arange(1.0, 0.0, -0.05)
            claims.append(next((s for s in steps if is_claimed(case, s * bounds.lower)), 0.0) * shares[-1])
    least, twentieth, median = np.quantile(shares, [0.0, 0.05, 0.5])
    print(f"robust mu of {count} grasps of fingertips, hands and grippers: lower end over the worst mu found")
    print(f"    {median:.2f} in the median, {twentieth:.2f} of the lowest twentieth, {least:.2f} at least;")
    print(f"    by an ordinary proof {np.median(claims):.2f} in the median of {claimed}, {min(claims):.2f} at least")
    print(f"    of {count * displaced} random displaced grasps, {below} are below the lower end")
    print(f"    CPU seconds {np.median(seconds):.2f} in the median, {max(seconds):.2f} at most")


def is_claimed(case, lower):
    """Return whether the ordinary claim that implies a lower end of robust mu is certified."""
    claim = ng.robust_claim(case.grasp, case.task, lower, OFFSET, case.angle, LOSS, force_budget=case.budget)
    return ng.mu(*claim, 0.03, force_budget=case.budget).lower >= 1.0


def run(part=None):
    if part == "friction":
        friction(1000)
        return
    if part == "robust":
        robust(100, 10_000, 30)
        return
    grasps = random_grasps()
    certificates(grasps)
    screening()
    forces(grasps)
    pyramids(grasps)
