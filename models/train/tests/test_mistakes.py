"""What Stage I answers, held against labels: records, teachers, encodings. No data needed."""

from __future__ import annotations

import pathlib
import sys
import tempfile
import unittest

import numpy as np
import torch

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(KIT), str(KIT / "tests")]

import mistakes
from crowd import PERSON
from mistakes import Looks, Mistakes, Seen, encodings, load, match, record, thresholds
from model import Stage2, channel_mask, stage2_input
from real import TRUST, mend
from skeleton import FLIP14, NB, NJ, PARENTS21, ROOT
from stage2 import KEPT, agreed, as_of_real_people, kept_answers, mirror, mirror3d, mirrored
from teacher import LANDMARK, TORSO_AND_LEGS, agreement, skeleton21, stature


class Reports(unittest.TestCase):
    """What Stage I answers, held against labels."""

    def test_exchanged_sides_are_recorded_as_such(self) -> None:
        right = np.concatenate([PERSON, np.full((NJ, 1), 0.8, np.float32)], 1)
        conf, at, off = record(right, PERSON, 150.0)
        self.assertEqual(at.tolist(), list(range(NJ)))
        self.assertEqual(float(np.abs(off).max()), 0.0)
        conf, at, off = record(right[FLIP14], PERSON, 150.0)
        limbs = [3, 4, 6, 7, 8, 9, 10, 11, 12, 13]
        self.assertEqual([int(at[j]) for j in limbs], [FLIP14[j] for j in limbs])

    def test_nobody_matched_is_said_in_a_line(self) -> None:
        nothing = lambda x: (torch.zeros(1, 40, 8, 8), torch.zeros(1, 3 * NB, 8, 8))  # noqa: E731
        shown = mistakes.Shown(torch.zeros(1, 3, 64, 64), [(PERSON, np.ones(NJ, bool), 150.0)], [torch.zeros(NB, 3)])
        with self.assertRaisesRegex(SystemExit, "^expected people whom the network finds"):
            mistakes.collect(nothing, [shown], thresholds(mistakes.ASSOCIATION))

    def test_everybody_is_matched_once(self) -> None:
        a = np.concatenate([PERSON, np.ones((NJ, 1), np.float32)], 1)
        b = a + np.array([200, 0, 0], np.float32)
        yes = np.ones(NJ, bool)
        truth = [(PERSON + np.array([200, 0], np.float32), yes, 150.0), (PERSON, yes, 150.0)]
        self.assertEqual(sorted(match([a, b, a + 3], truth)), [(0, 1), (1, 0)])

    def test_mistakes_are_carried_over_to_other_poses(self) -> None:
        n, g = 200, torch.Generator().manual_seed(5)
        rel = torch.randn(n, 21, 3, generator=g) * 0.3
        uv = rel[:, :NJ, :2] * 100
        true = (rel - rel[:, PARENTS21]).flatten(1)[:, None] * channel_mask()
        conf = torch.ones(n, NJ)
        conf[:, 4] = 0
        slope = torch.tensor([0.6, 0.9, 0.4]).repeat(NB)
        # encodings that follow the truth, only less: there is nothing left to explain
        found, wrong = encodings(Seen(uv, conf, (true * slope).half(), rel))
        self.assertLess(float((found - slope[:3]).abs().max()), 0.01)
        self.assertLess(float(wrong.abs().max()), 0.01)
        wrong[:, 9] += 0.2 * channel_mask()[9]
        lifted = torch.arange(n) % 2 == 0
        at = torch.arange(NJ).expand(n, -1)
        m = Mistakes(conf, at, torch.zeros(n, NJ, 2), wrong.float(), lifted, found.expand(n, 3))
        q, c, enc = m.apply(uv, torch.full((n,), 170.0), rel, g)
        self.assertLess(float((q - uv).norm(dim=2).mean()), 0.02 * 170)
        # the wrist that was missed and the knee that was wrong change sides in a mirror, and half of the records know no encodings
        self.assertEqual(sorted({tuple((r == 0).nonzero()[:, 0].tolist()) for r in c}), [(4,), (7,)])
        known = enc.abs().sum((1, 2)) > 0
        self.assertTrue(60 < int(known.sum()) < 140)
        off = (enc - true * slope * (c > 0)[..., None]).abs().amax(2)[known]
        right = c[known][:, 4] == 0
        for rows, knee in ((right, 9), (~right, 12)):
            self.assertLess(float((off[rows][:, knee] - 0.2).abs().max()), 0.01)
            self.assertLess(float(off[rows][:, [j for j in range(NJ) if j != knee]].max()), 0.01)

    def test_people_of_several_files_keep_their_slopes(self) -> None:
        def files(folder: pathlib.Path, first: int) -> pathlib.Path:
            n, ones = 30, torch.ones(30, dtype=torch.bool)
            conf = torch.full((n, NJ), 0.1 * first)
            m = Mistakes(conf, torch.zeros(n, NJ, dtype=torch.long), torch.zeros(n, NJ, 2), torch.zeros(n, NJ, 63), ones, torch.full((n, 3), 0.3 * first))
            seen = Seen(torch.zeros(n, NJ, 2), conf, torch.zeros(n, NJ, 63), torch.zeros(n, NB, 3))
            looks = Looks(seen.uv[:first], conf[:first], seen.enc[:first])
            torch.save({"mistakes": m.__dict__, "seen": seen.__dict__, "looks": looks.__dict__, "open": False}, folder / f"{first}.pt")
            return folder / f"{first}.pt"

        with tempfile.TemporaryDirectory() as d:
            paths = [files(pathlib.Path(d), k) for k in (1, 2)]
            m, seen, looks = load(paths, torch.device("cpu"))
            old = torch.load(paths[0], weights_only=True)
            del old["looks"]
            torch.save(old, paths[0])
            with self.assertRaisesRegex(SystemExit, "collect it again"):
                load(paths, torch.device("cpu"))
        torch.testing.assert_close(m.slope[:, 0], 3 * m.conf[:, 0])
        self.assertEqual((len(seen.conf), len(looks.conf)), (60, 3))
        part = m.take(slice(7))
        self.assertEqual(len(set(part.conf[:, 0].tolist())), 2)  # shuffled: the first few are of both
        torch.testing.assert_close(part.slope[:, 0], 3 * part.conf[:, 0])

    def test_what_a_network_says_of_real_people_is_kept_but_for_those_close_by(self) -> None:
        g = torch.Generator().manual_seed(4)
        net = Stage2().eval()
        torch.nn.init.normal_(net.fc5[0].weight, std=0.1, generator=g)
        uv = torch.randn(40, NJ, 2, generator=g) * torch.linspace(10, 200, 40)[:, None, None]
        conf = torch.rand(40, NJ, generator=g) * (torch.rand(40, NJ, generator=g) > 0.2)
        enc = torch.randn(40, NJ, 63, generator=g) * 0.2 * channel_mask()
        *answer, rel = kept_answers(net, Looks(uv, conf, enc), channel_mask())
        tall = [float(np.ptp(q[c > 0, 1])) for q, c in zip(uv.numpy(), conf.numpy())]
        self.assertTrue(0 < len(rel) < 40)
        self.assertEqual(len(rel), sum(t < KEPT for t in tall))
        _, *other = kept_answers(net, Looks(*mirror(uv, conf, enc)), channel_mask())
        torch.testing.assert_close(mirror3d(other[-1]), rel, rtol=1e-4, atol=1e-5)

    def test_what_networks_agree_on_does_not_depend_on_the_side(self) -> None:
        g = torch.Generator().manual_seed(9)
        nets = [Stage2().eval() for _ in range(2)]
        for k, net in enumerate(nets):
            torch.nn.init.normal_(net.fc5[0].weight, std=0.1 * (k + 1), generator=g)
        uv, conf = torch.randn(6, NJ, 2, generator=g) * 40, torch.rand(6, NJ, generator=g)
        enc = torch.randn(6, NJ, 63, generator=g) * 0.2 * channel_mask()
        told = agreed(nets, uv, conf, enc, channel_mask())
        other = agreed(nets, *mirror(uv, conf, enc), channel_mask())
        torch.testing.assert_close(other, mirror3d(told), rtol=1e-4, atol=1e-5)
        looks = [(e, turn) for e in (enc, torch.zeros_like(enc)) for turn in (False, True)]
        by_hand = torch.zeros_like(told)
        for e, turn in looks:
            for net in nets:
                seen = mirror(uv, conf, e) if turn else (uv, conf, e)
                answer = net(stage2_input(*seen, channel_mask())).detach()
                by_hand += (mirror3d(answer) if turn else answer) / 8
        torch.testing.assert_close(told, by_hand, rtol=1e-4, atol=1e-5)

    def test_encodings_become_as_shallow_as_asked_and_missing_ones_stay_missing(self) -> None:
        g = torch.Generator().manual_seed(4)
        n = 4000
        enc = (0.3 * torch.ones(n, NJ, 63)) * channel_mask()
        enc[:, 5] = 0
        torch.testing.assert_close(as_of_real_people(enc, 0.0, g), enc)
        real = as_of_real_people(enc, 1.0, g)
        self.assertEqual(float(real[:, 5].abs().max()), 0)
        self.assertEqual(float((real * (channel_mask() == 0)).abs().max()), 0)
        across, down, depth = (float(real[..., k::3][enc[..., k::3] > 0].mean()) / 0.3 for k in range(3))
        self.assertTrue(0.9 < across < 0.97 and 0.9 < down < 0.97 and 0.75 < depth < 0.85, (across, down, depth))
        self.assertLess(float(real[0, 2, 9:12].sub(real[0, 3, 9:12]).abs().max()), 1e-6)  # one bone, read at both of its ends

    def test_a_mirrored_person_is_still_a_person(self) -> None:
        n = 64
        rel = torch.randn(1, 21, 3).expand(n, -1, -1) * 0.3
        rel = rel - rel[:, ROOT : ROOT + 1]
        enc = (rel - rel[:, PARENTS21]).flatten(1)[:, None].expand(-1, NJ, -1) * channel_mask()
        uv = rel[:, :NJ, :2] * 100
        uv, conf, enc, rel = mirrored(uv, torch.ones(n, NJ), enc, rel, torch.Generator().manual_seed(3))
        bones = (rel - rel[:, PARENTS21]).flatten(1)[:, None] * channel_mask()
        self.assertLess(float((enc - bones).abs().max()), 1e-5)
        self.assertLess(float((uv / 100 - rel[:, :NJ, :2]).abs().mean()), 0.05)
        self.assertGreater(len(rel[:, 2, 0].unique()), 1)

    def test_a_teacher_speaks_of_our_skeleton(self) -> None:
        w = np.zeros((33, 3), np.float32)
        for j, k in LANDMARK.items():
            w[k, :2] = PERSON[j] / 100
        j21 = skeleton21(w)
        self.assertLess(float(np.abs(j21[2:14, :2] - (PERSON[2:] - PERSON[[8, 11]].mean(0)) / 100).max()), 1e-6)
        self.assertEqual(float(np.abs(j21[ROOT]).max()), 0.0)
        legs = sum(np.linalg.norm(PERSON[a] - PERSON[b]) for a, b in ((8, 9), (9, 10), (11, 12), (12, 13))) / 200
        self.assertAlmostEqual(stature(j21), (legs + 0.47) / TORSO_AND_LEGS, 5)
        labels = np.concatenate([PERSON, np.ones((NJ, 1), np.float32)], 1)
        self.assertEqual(agreement(labels, labels), (1.0, 0.0))
        self.assertLess(agreement(labels[FLIP14], labels)[0], 0.9)

    def test_a_teacher_mends_what_it_agrees_with_roughly(self) -> None:
        labels = np.concatenate([np.stack([PERSON] * 3), np.ones((3, NJ, 1))], 2).astype(np.float32)
        labels[0, 0, 2] = 0
        teacher = labels.copy()
        teacher[:, :2, 2] = 0  # it knows neither head top nor neck
        torso = float(np.linalg.norm(PERSON[[2, 5]].mean(0) - PERSON[[8, 11]].mean(0)))
        teacher[0, 3, 0] += 0.2 * torso  # near
        teacher[0, 4, 0] += 0.7 * torso  # a contradiction
        teacher[0, 7, 0] += 0.2 * torso
        teacher[0, 7, 2] = 0.4  # it is not sure itself
        teacher[1, :, 0] += 0.7 * torso  # somebody else
        teacher[2] = 0  # no answer
        out, doubt = mend(labels, teacher)
        self.assertEqual(doubt.tolist(), [False, True, False])
        self.assertTrue(np.array_equal(out[1:], labels[1:]))
        self.assertAlmostEqual(float(out[0, 3, 0] - labels[0, 3, 0]), 0.2 * TRUST * torso, 3)
        self.assertEqual(out[0, :, 2].tolist(), [0.0, 1, 1, 1, 0.0] + [1] * 9)
        same = [j for j in range(NJ) if j != 3]
        self.assertTrue(np.array_equal(out[0, same, :2], labels[0, same, :2]))


if __name__ == "__main__":
    unittest.main()
