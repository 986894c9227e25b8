"""Queries that a saved map answers where it can, and the engine where it cannot."""

from __future__ import annotations

import time

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.ftws_map import FtwsMap, arm_fingerprint
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict

_REASONS = {
    Verdict.MEMBER: 'in a cell of the map that is proved to be in the FTWS as a whole',
    Verdict.NON_MEMBER: 'in a cell of the map of which every point is proved lost',
}


def query_with_map(
    ftws_map: FtwsMap,
    chain: SerialChain,
    points: Array,
    *,
    settings: FtwsSettings | None = None,
    threads: int = 1,
) -> list[FtwsResult]:
    """Judge positions of the map's order: by the map, or else by the engine.

    A map tells verdicts alone: its answers have no witness, intervals or margin.

    Parameters
    ----------
    points : ndarray, shape (N, 3), m
    settings, threads
        Of the engine, as for `query.query`.

    Raises
    ------
    InputError
        If the map is of another arm or tolerance, or as `query.query`.
    """
    settings = settings or FtwsSettings()
    if ftws_map.fingerprint != arm_fingerprint(chain):
        raise InputError('map', f'is of {ftws_map.arm!r}, not of {chain.name!r} as it is now')
    if ftws_map.tolerance != settings.tolerance:
        raise InputError(
            'tolerance', f'is {settings.tolerance:g}; the map was made for {ftws_map.tolerance:g}'
        )
    results: list[FtwsResult | None] = []
    for point in points:
        started = time.perf_counter()
        verdict = ftws_map.lookup(point)
        elapsed = time.perf_counter() - started
        x, y, z = point.tolist()
        results.append(
            FtwsResult((x, y, z), verdict, _REASONS[verdict], elapsed_s=elapsed)
            if verdict in _REASONS
            else None
        )
    rest = [i for i, result in enumerate(results) if result is None]
    judged = query(chain, points[rest], order=ftws_map.order, settings=settings, threads=threads)
    for i, result in zip(rest, judged, strict=True):
        results[i] = result
    return [result for result in results if result is not None]
