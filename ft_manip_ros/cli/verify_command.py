"""`ftmanip verify`: check the proofs in a certificate with an independent verifier."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.certificate import load_certificate, verify


def add_parser(subparsers: Any) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        'verify',
        help='check verdicts and their proofs again',
        description='Check every proof of a certificate written by ftmanip ftws --certificate, '
        'with a verifier that shares no code with the engine. Exit code 1: not confirmed.',
    )
    parser.add_argument('certificate', help='JSON file')
    parser.add_argument('--arm', help='also check that the certificate is about this arm')
    parser.add_argument('--base', help='base link, for a URDF')
    parser.add_argument('--tip', help='tip link, for a URDF')


def run(args: argparse.Namespace) -> int:
    """Verify and print one line a goal."""
    document = load_certificate(args.certificate)
    if args.arm:
        _compare(args, document)
    failed = 0
    total = 0
    centres = [goal['point'] for goal in document['goals']]
    centres += [region.get('center', []) for region in document.get('regions', ())]
    for (confirmed, text), centre in zip(verify(document), centres, strict=False):
        point = ', '.join(f'{value:g}' for value in centre)
        print(f'{"confirmed" if confirmed else "REJECTED "}  ({point})  {text}', flush=True)
        failed += not confirmed
        total += 1
    print(f'{total - failed} of {total} confirmed')
    return 1 if failed else 0


def _compare(args: argparse.Namespace, document: dict[str, Any]) -> None:
    """Refuse a certificate of another arm."""
    chain = load_arm(args.arm, base=args.base, tip=args.tip)
    arm = document['arm']
    n = chain.n
    same = (
        # A free tool axis adds one joint that never fails.
        [joint['name'] for joint in arm['joints'] if joint['fails']] == list(chain.joint_names)
        and np.allclose(arm['rotations'][: n + 1], chain.rotations, atol=1e-12)
        and np.allclose(arm['translations'][: n + 1], chain.translations, atol=1e-12)
        and all(
            (joint['lower'], joint['upper'], tuple(joint['operating']))
            == (mine.lower, mine.upper, mine.operating)
            for joint, mine in zip(arm['joints'], chain.joints, strict=False)
        )
    )
    if not same:
        raise InputError(args.certificate, f'is about another arm than {chain.name!r}')
