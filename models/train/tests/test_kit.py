"""Tests that need no data: python -m unittest discover -s models/train/tests"""

from __future__ import annotations

import argparse
import io
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import tomllib
import unittest
from unittest import mock

import numpy as np
import torch
from PIL import Image

KIT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(KIT))

import card
import checkpoint
import choices
import clock
import export
import mistakes
import muon
import pack
import person_score
import photos
import prerender
import quant
import real
import targets
import terms
import truth
import weights
from augment import sharpen
from clips import SEEDS, line, people_of, row, total
from composites import HIDDEN, OUTSIDE, VISIBLE, person, visibility
from distil import SEEN, Teachers, mirror_encodings, mirror_maps
from dim import FULL_WELL, READ_NOISE, dim, linear, stored
from framed import FRAME, cut_off, frame
from group import argmax_joints, people
from letterbox import letterbox, to_original
from model import SelecSLSNet, Stage2, channel_mask, stage2_input
from muon import Muon, orthogonal
from skeleton import BONES_AT, FLIP14, FLIP21, LIMBS, NB, NJ, PARENTS21, ROOT, TOPO21, limb_chain
from measure import errors, naive, procrustes
from pool import FIELDS, Pool, Stored
from posed import Posed
from real import TRUST, arrange, mend
from renorm import LIMITS, BatchRenorm2d
from mistakes import Looks, Mistakes, Seen, encodings, load, match, record, thresholds
from stage2 import KEPT, People3D, agreed, as_of_real_people, imitate, kept_answers, mirror, mirror3d, mirrored
from teacher import LANDMARK, TORSO_AND_LEGS, agreement, skeleton21, stature
from windows import most_seen, seen_through, window

# A person standing, 150 px tall: head top, neck, right arm, left arm, right leg, left leg.
PERSON = np.array(
    [[0, 0], [0, 25], [-18, 28], [-24, 52], [-26, 75], [18, 28], [24, 52], [26, 75], [-10, 75], [-11, 110], [-12, 145], [10, 75], [11, 110], [12, 145]],
    np.float32,
)


def crowd(*at: tuple[float, float]) -> torch.Tensor:
    """[1, P, 14, 2]"""
    return torch.from_numpy(np.stack([PERSON + np.array(p, np.float32) for p in at]))[None]


class Skeleton(unittest.TestCase):
    def test_tables_agree(self) -> None:
        self.assertEqual(sorted(TOPO21), list(range(NB)))
        for b in TOPO21:
            if b != ROOT:
                self.assertLess(TOPO21.index(PARENTS21[b]), TOPO21.index(b))
        for flip in (FLIP14, FLIP21):
            self.assertEqual([flip[flip[j]] for j in range(len(flip))], list(range(len(flip))))
        carried = {b for bones in BONES_AT for b in bones}
        self.assertEqual(carried, set(range(NB)) - {ROOT})  # every bone can be read somewhere


class Distillation(unittest.TestCase):
    WIDTH = 256

    def labels(self, j: torch.Tensor, rel: torch.Tensor) -> targets.Targets:
        seen, size = torch.ones(1, len(j[0]), NJ), torch.full((1, len(j[0])), 150.0)
        return targets.synthetic(j, seen, rel, size, size / 50, 40, self.WIDTH // 8)

    def test_maps_of_the_mirror_image_are_those_of_the_mirrored_people(self) -> None:
        j = crowd((70, 60), (180, 90))
        rel = torch.randn(1, 2, NB, 3, generator=torch.Generator().manual_seed(1))
        flipped = (j * torch.tensor([-1.0, 1.0]) + torch.tensor([self.WIDTH - 1.0, 0.0]))[:, :, FLIP14]
        here, there = self.labels(j, rel), self.labels(flipped, mirror3d(rel.flatten(0, 1)).view_as(rel))
        self.assertLess((mirror_maps(there.maps) - here.maps).abs().max(), 1e-4)
        self.assertLess((mirror_encodings(there.enc) - here.enc).abs().max(), 1e-4)
        self.assertGreater((there.maps - here.maps).abs().max(), 0.5)  # they do differ unmirrored

    def test_folded_and_together_the_teachers_say_the_mean(self) -> None:
        nets = []
        with tempfile.TemporaryDirectory() as d:
            files = [pathlib.Path(d) / f"{k}.safetensors" for k in range(2)]
            for k, f in enumerate(files):
                torch.manual_seed(k)
                net = SelecSLSNet().eval()
                for m in net.modules():
                    if isinstance(m, BatchRenorm2d):
                        m.running_mean.normal_(0, 0.1)
                        m.running_var.uniform_(0.5, 2)
                net.head2d.out.bias.data[:NJ] += SEEN * torch.arange(NJ) / 6  # some joints are seen, others not
                weights.write(f, export.slim(net.state_dict(), True), {})
                nets.append(net)
            teachers = Teachers(files, torch.device("cpu"), False)
        x = torch.rand(2, 3, 64, 96) - 0.5
        with torch.no_grad():
            plain = [net(x) for net in nets]
            other = [(mirror_maps(y), mirror_encodings(e)) for y, e in (net(x.flip(3)) for net in nets)]
        for turn in range(2):  # every network sees the mirror image every second time
            t = teachers.answer(x, turn)
            both = [plain[0], other[1]] if turn == 0 else [other[0], plain[1]]
            maps, enc = ((a + b) / 2 for a, b in zip(*both))
            self.assertLess((t.maps - maps).abs().max(), 1e-4)
            self.assertLess((t.enc - enc).abs().max(), 1e-4)
            seen = maps[:, :NJ] > SEEN
            self.assertTrue(0 < seen.sum() < seen.numel())
            for b in range(NB):
                want = torch.stack([seen[:, k] for k in range(NJ) if b in BONES_AT[k]]).any(0) if b != ROOT else torch.zeros_like(seen[:, 0])
                self.assertTrue(torch.equal(t.enc_weight[:, 3 * b] > 0, want))


class Clips(unittest.TestCase):
    def report(self, matched: int, mpjpe: float, found: int, identity: dict | None = None) -> dict:
        pose = dict(truth=10, people=matched, mpjpe_mm=mpjpe, canonical_mpjpe_mm=mpjpe / 4, n_mpjpe_mm=mpjpe / 3, pa_mpjpe_mm=mpjpe / 2, pck150=0.5)
        return dict(pose3d=pose, finding=[{}, dict(people=8, found=found, predictions=9)], identity=identity)

    def test_everybody_counts_alike_whatever_clip_they_are_in(self) -> None:
        t = total([row(self.report(9, 50, 8)), row(self.report(3, 90, 4))])
        self.assertEqual((t["truth"], t["matched"], t["asked"], t["found"], t["reports"]), (20, 12, 16, 12, 18))
        self.assertAlmostEqual(t["mpjpe"], 60)
        self.assertAlmostEqual(t["pa"], 30)
        self.assertAlmostEqual(t["same_size"], 15)
        self.assertAlmostEqual(t["scaled"], 20)

    def test_identities_count_by_appearances(self) -> None:
        few, many = dict(idf1=0.5, truth=4, predicted=6, switches=2), dict(idf1=1.0, truth=20, predicted=20, switches=1)
        t = total([row(self.report(9, 50, 8, few)), row(self.report(9, 50, 8, many))])
        self.assertAlmostEqual(t["idf1"], 0.9)
        self.assertEqual(t["switches"], 3)
        self.assertTrue(line("all", t).endswith("| 90.0 %, 3 |"))
        self.assertTrue(line("seen", total([row(self.report(9, 50, 8))])).endswith("| – |"))

    def test_nobody_found_is_no_error(self) -> None:
        nobody = self.report(0, 0, 0) | dict(pose3d=None, coco=dict(people=7))
        both = total([row(nobody), row(self.report(5, 60, 8))])
        self.assertEqual((both["truth"], both["matched"], both["mpjpe"]), (17, 5, 60))

    def test_clips_hold_two_to_six_people(self) -> None:
        self.assertEqual([people_of(s) for s in SEEDS], [2, 3, 4, 5, 6] * 2)


class Grouping(unittest.TestCase):
    def test_a_neck_has_a_threshold_of_its_own(self) -> None:
        maps = torch.zeros(40, 20, 20)
        maps[1, 10, 10] = 0.25
        self.assertEqual(len(people(maps, thr=0.2, min_joints=1)), 1)
        self.assertEqual(len(people(maps, thr=0.2, min_joints=1, neck_thr=0.3)), 0)

    def test_mistakes_are_asked_for_by_the_program_s_thresholds(self) -> None:
        self.assertEqual(thresholds(KIT.parent / "association.toml"), dict(thr=0.2, neck_thr=0.3, paf_thr=0.05, min_joints=4))

    def test_a_gaussian_s_middle_is_found_exactly(self) -> None:
        y, x = torch.meshgrid(torch.arange(16.0), torch.arange(16.0), indexing="ij")
        hm = torch.exp(-0.5 * ((x - 7.3) ** 2 + (y - 8.4) ** 2) / 0.9**2)[None, None]
        at = argmax_joints(hm.expand(-1, NJ, -1, -1))[0, 0]
        np.testing.assert_allclose(at, [8 * 7.3 + 3.5, 8 * 8.4 + 3.5], atol=0.02)

    def test_people_come_back_from_their_own_maps(self) -> None:
        j = crowd((80, 60), (200, 90), (330, 40))
        hm, paf, _, _ = targets.maps(j, torch.ones(1, 3, NJ, dtype=torch.bool), torch.full((1, 3), 150.0), 40, 64)
        found = people(torch.cat([hm, paf], 1)[0])
        self.assertEqual(len(found), 3)
        for p in j[0].numpy():
            best = min(float(np.abs(q[:, :2] - p).max()) for q in found if (q[:, 2] > 0).all())
            self.assertLess(best, 3.0)

    def test_empty_maps_hold_nobody(self) -> None:
        self.assertEqual(people(torch.zeros(40, 40, 64)), [])
        self.assertEqual(people(torch.full((40, 40, 64), 0.2)), [])

    def test_maximum_of_each_map(self) -> None:
        j = crowd((100, 60))
        hm, _, _, _ = targets.maps(j, torch.ones(1, 1, NJ, dtype=torch.bool), torch.full((1, 1), 150.0), 40, 64)
        self.assertLess(np.abs(argmax_joints(hm)[0] - j[0, 0].numpy()).max(), 3.0)


class Targets(unittest.TestCase):
    def test_fields_point_to_the_parent(self) -> None:
        j = crowd((100, 60))
        _, paf, _, _ = targets.maps(j, torch.ones(1, 1, NJ, dtype=torch.bool), torch.full((1, 1), 150.0), 40, 64)
        for limb, (c, p) in enumerate(LIMBS):
            u = (j[0, 0, p] - j[0, 0, c]) / (j[0, 0, p] - j[0, 0, c]).norm()
            mid = ((j[0, 0, c] + j[0, 0, p]) / 2 - 3.5) / 8
            if (j[0, 0, p] - j[0, 0, c]).norm() < 16:
                continue
            x, y = (int(v) for v in mid.round())
            self.assertGreater(float(paf[0, 2 * limb : 2 * limb + 2, y, x] @ u), 0.8)

    def test_losses_vanish_on_the_target_only(self) -> None:
        j = crowd((100, 60))
        rel = torch.randn(1, 1, 21, 3) * 0.3
        t = targets.synthetic(j, torch.ones(1, 1, NJ), rel, torch.full((1, 1), 150.0), torch.full((1, 1), 4.0), 40, 64)
        self.assertEqual(float(sum(targets.loss2d(t.maps, t))), 0.0)
        self.assertLess(abs(float(targets.location_loss(t.maps, t))), 1e-4)
        self.assertEqual(float(targets.loss3d(t.enc, t)), 0.0)
        off = t.maps.roll(3, 3)
        self.assertGreater(float(targets.location_loss(off, t)), 0.1)
        self.assertGreater(float(sum(targets.loss2d(off, t))), 0.01)

    def test_unlabelled_surroundings_are_ignored(self) -> None:
        j = crowd((100, 60))
        known = torch.zeros(1, 40, 64)
        known[:, 4:30, 8:20] = 1
        box = known[:, None] > 0
        yes = torch.ones(1, 1, dtype=torch.bool)
        rel = torch.randn(1, 1, 21, 3)
        t = targets.real(j, yes[..., None].expand(1, 1, NJ), torch.zeros(1, 1, NJ, dtype=torch.bool), torch.full((1, 1), 150.0), known, box, rel, yes)
        self.assertEqual(float(t.weight[..., 40:].sum()), 0.0)
        self.assertGreater(float(t.weight.sum()), 0.0)

    def test_only_lifted_people_lend_depth(self) -> None:
        j = crowd((60, 60), (200, 60))
        lab, size = torch.ones(1, 2, NJ, dtype=torch.bool), torch.full((1, 2), 150.0)
        rel = torch.randn(1, 2, 21, 3)
        known, box = torch.ones(1, 40, 64), torch.zeros(1, 2, 40, 64, dtype=torch.bool)
        t = targets.real(j, lab, ~lab, size, known, box, rel, torch.tensor([[True, False]]))
        x, y = (int(v) for v in ((j[0, 0, 3] - 3.5) / 8).round())
        bone = rel[0, 0, 3] - rel[0, 0, 2]
        self.assertTrue(torch.allclose(t.enc[0, 9:12, y, x], bone))
        self.assertEqual(float(t.enc_weight[..., 17:].sum()), 0.0)  # the second person stands there


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


class Scores(unittest.TestCase):
    FEATURES = 2 * NJ + len(LIMBS) + 3

    def lines(self, folder: pathlib.Path, people: int, pictures: int, clear: float, similar: float) -> pathlib.Path:
        """Pictures of one candidate each: right where the first joint is clear."""
        path = folder / f"{people}-{clear}.jsonl"
        features = [clear] + [0.5] * (self.FEATURES - 1)
        candidate = dict(features=features, oks=[similar] * people)
        row = dict(settings=[0.4, 0.2, 0.1, 0.05], set=path.name, source="a.jpg", crowd=[False] * people, candidates=[candidate])
        path.write_text(f"{json.dumps(row)}\n" * pictures)
        return path

    def test_whom_a_candidate_is_taken_for(self) -> None:
        similar = np.array([[0.9, 0.2], [0.8, 0.0], [0.1, 0.3]])
        own, counts = person_score.assign(similar, np.array([False, False]))
        self.assertEqual((own.tolist(), counts.tolist()), ([0.9, 0.0, 0.3], [True] * 3))  # the second is a double
        own, counts = person_score.assign(similar, np.array([False, True]))
        self.assertEqual(counts.tolist(), [False, True, False])  # too near somebody who does not count
        own, counts = person_score.assign(np.zeros((2, 0)), np.zeros(0, bool))
        self.assertEqual((own.tolist(), counts.tolist()), ([0.0, 0.0], [True, True]))

    def test_what_is_learnt_tells_people_from_nobody(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            folder = pathlib.Path(d)
            some = self.lines(folder, 1, 30, 0.9, 0.8).read_text() + self.lines(folder, 0, 30, 0.1, 0.0).read_text()
            (folder / "all.jsonl").write_text(some)
            toml = folder / "association.toml"
            shutil.copy(KIT.parent / "association.toml", toml)
            before = tomllib.loads(toml.read_text())
            person_score.main([str(folder / "all.jsonl"), "--held", str(folder / "all.jsonl"), "--toml", str(toml)])
            after = tomllib.loads(toml.read_text())
            fitted = {*person_score.KEYS, "min_score", "score"}
            self.assertEqual(*({k: v for k, v in x.items() if k not in fitted} for x in (before, after)))
            self.assertEqual([after[k] for k in person_score.KEYS], [0.4, 0.2, 0.1, 0.05])
            c = person_score.load(folder / "all.jsonl")[0.4, 0.2, 0.1, 0.05]
            weights, bias = person_score.fit(c)
            s = person_score.score(c, weights, bias)
            self.assertLess(abs(s[:30].mean() - 0.8), 0.05)  # the score is the similarity to be expected
            self.assertLess(s[30:].max(), 0.05)
            self.assertAlmostEqual(after["score"]["joint"][0], float(weights[0]), places=3)
            self.assertTrue(s[30:].max() < after["min_score"] < s[:30].min())

    def test_reports_end_where_they_do_more_harm_than_good(self) -> None:
        similar = np.array([0.9, 0.2, 0.5, 0.1, 0.2])  # worth 0.6, -0.1, 0.2, -0.2, -0.1
        nothing = np.zeros(5)
        c = person_score.Candidates(nothing, similar, nothing, nothing, {}, {})
        scores = np.array([0.8, 0.6, 0.5, 0.4, 0.1])
        self.assertAlmostEqual(person_score.best_threshold(c, scores), 0.45)
        c.similarity = np.full(5, 0.9)
        self.assertAlmostEqual(person_score.best_threshold(c, scores), 0.05)

    def test_without_photos_of_nobody_there_is_no_threshold(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            c = person_score.load(self.lines(pathlib.Path(d), 1, 3, 0.9, 0.0))[0.4, 0.2, 0.1, 0.05]
        with self.assertRaisesRegex(SystemExit, "expected photos without people"):
            person_score.threshold(c, np.ones(3), 0.95)

    def test_a_file_of_other_keys_is_refused(self) -> None:
        with self.assertRaisesRegex(SystemExit, "expected one line 'bias = …'"):
            person_score.written("min_score = 1\n", dict(bias=2.0))

    def test_composites_say_who_can_be_seen(self) -> None:
        joints = crowd((80, 60), (500, 300))[0].numpy()
        labelled = np.ones((2, NJ), bool)
        labelled[0, 3] = False
        codes = visibility(joints, labelled)
        self.assertEqual((codes[0, 3], codes[0, 4], codes[1, 13]), (HIDDEN, VISIBLE, OUTSIDE))
        p = person(7, joints[0], codes[0])
        self.assertEqual((len(p["joints2d"]), len(p["visibility"]), p["visibility"][NJ:]), (NB, NB, [HIDDEN] * (NB - NJ)))


class Sharpening(unittest.TestCase):
    def test_edges_get_steeper_and_flat_places_stay(self) -> None:
        edge = torch.full((2, 3, 16, 16), 0.3)
        edge[..., 8:] = 0.7
        edge = torch.nn.functional.avg_pool2d(torch.nn.functional.pad(edge, (1, 1, 1, 1), mode="replicate"), 3, 1)
        same, sharp = sharpen(edge, torch.tensor([0.0, 1.5]))
        torch.testing.assert_close(same, edge[0])
        torch.testing.assert_close(sharp[..., [0, -1]], edge[1][..., [0, -1]])
        self.assertGreater(float(sharp.diff(dim=2).max()), 1.4 * float(edge.diff(dim=3).max()))


class Dimming(unittest.TestCase):
    def test_gain_brings_back_brightness_and_not_what_was_lost(self) -> None:
        rng = np.random.default_rng(3)
        picture = np.full((64, 64, 3), 120, np.uint8)
        same, weak, dark = (dim(picture, light, 8.0, rng) for light in (1.0, 0.125, 0.02))
        for x in (same, weak):
            self.assertLess(abs(float(linear(x / 255.0).mean()) / linear(np.array(120 / 255.0)) - 1), 0.02)
        # beyond the gain it gets darker: 0.02 · 8 of the light
        self.assertLess(abs(float(linear(dark / 255.0).mean()) / (0.16 * linear(np.array(120 / 255.0))) - 1), 0.05)
        # the fewer the photons, the larger their relative noise: √(n + 4²) / n with n electrons
        for x, light in ((weak, 0.125), (dark, 0.02)):
            n = FULL_WELL * light * linear(np.array(120 / 255.0))
            v = linear(x / 255.0)
            self.assertLess(abs(float(v.std() / v.mean()) / (np.sqrt(n + READ_NOISE**2) / n) - 1), 0.1)

    def test_stored_undoes_linear(self) -> None:
        x = np.linspace(0, 1, 256)
        self.assertLess(np.abs(stored(linear(x)) - x).max(), 1e-6)


class Framed(unittest.TestCase):
    def test_joints_stay_on_their_pixels_and_people_get_the_wanted_size(self) -> None:
        joints = np.concatenate([PERSON + np.array([40, 20], np.float32), np.ones((NJ, 1), np.float32)], 1)
        photo = np.full((190, 80, 3), 20, np.uint8)
        photo[17:24, 37:44] = photo[162:169, 25:32] = 255  # head top and right ankle
        for tall in (70.0, 150.0, 900.0):
            picture, moved = frame(Image.fromarray(photo), joints, tall)
            self.assertEqual(picture.size, FRAME)
            wanted = min(tall, FRAME[1] / 190 * float(limb_chain(joints[None])[0]))
            self.assertAlmostEqual(float(limb_chain(moved[None])[0]), wanted, delta=0.03 * wanted)
            x = np.asarray(picture, np.float32)[..., 0]
            for j in (0, 10):
                c, r = moved[j, :2]
                ys, xs = np.mgrid[int(r) - 8 : int(r) + 9, int(c) - 8 : int(c) + 9]
                bright = np.maximum(x[ys, xs] - 20, 0)
                self.assertAlmostEqual(float((bright * xs).sum() / bright.sum()), c, delta=0.3)
                self.assertAlmostEqual(float((bright * ys).sum() / bright.sum()), r, delta=0.3)


    def test_who_is_cut_off_fills_the_frame_down_to_the_cut(self) -> None:
        joints = np.concatenate([PERSON + np.array([40, 20], np.float32), np.ones((NJ, 1), np.float32)], 1)
        photo = np.full((190, 80, 3), 20, np.uint8)
        photo[17:24, 37:44] = 255  # head top
        for where, hips, knees in (("hips", 1, 0), ("thighs", 1, 0)):
            cut = cut_off(Image.fromarray(photo), joints, where)
            assert cut is not None
            picture, moved = cut
            self.assertEqual(picture.size, FRAME)
            self.assertAlmostEqual(moved[0, 1], 0.25 * FRAME[1], delta=2)
            self.assertEqual(moved[[8, 11], 2].tolist(), [hips, hips])
            self.assertEqual(moved[[9, 12, 10, 13], 2].tolist(), [knees] * 4)
            x = np.maximum(np.asarray(picture, np.float32)[..., 0] - 120, 0)  # beside the photo it is grey
            ys, xs = np.mgrid[: FRAME[1], : FRAME[0]]
            self.assertAlmostEqual(float((x * xs).sum() / x.sum()), moved[0, 0], delta=0.5)
            self.assertAlmostEqual(float((x * ys).sum() / x.sum()), moved[0, 1], delta=0.5)
        lying = joints.copy()
        lying[:, :2] = joints[:, [1, 0]]
        self.assertIsNone(cut_off(Image.fromarray(photo), lying, "hips"))


class Windows(unittest.TestCase):
    def test_a_window_keeps_rays_and_says_who_is_outside(self) -> None:
        rng = np.random.default_rng(1)
        camera = dict(fx=900.0, fy=900.0, cx=511.5, cy=319.5)
        joints3d = np.array([[0.0, -0.8 + 0.08 * j, 3.0] for j in range(NB)])
        joints2d = joints3d[:, :2] / joints3d[:, 2:] * 900 + [511.5, 319.5]
        one = dict(stature=1.7, joints3d=joints3d.tolist(), joints2d=joints2d.tolist(), visibility=[1] * NB, box=[400.0, 50.0, 600.0, 600.0], pixels=9e4)
        left, upper, scale = window(one, camera, (1024, 640), (600, 600), rng)
        self.assertAlmostEqual(scale * 900 * 1.7 / joints3d[ROOT][2], 600, delta=1)
        [seen] = seen_through([one], left, upper, scale)
        there = np.array(seen["joints2d"])
        inside = (there > -0.5).all(1) & (there < np.array([512, 320]) - 0.5).all(1)
        self.assertTrue(inside[0] and not inside[NB - 1])
        self.assertEqual(seen["visibility"], inside.astype(int).tolist())
        moved = (np.array([511.5, 319.5]) + 0.5 - [left, upper]) * scale - 0.5
        rays = joints3d[:, :2] / joints3d[:, 2:] * 900 * scale + moved
        self.assertLess(np.abs(rays - there).max(), 0.02)
        self.assertLessEqual(seen["box"][3], 320)
        self.assertLess(seen["pixels"], 9e4 * scale**2)
        self.assertEqual(seen_through([one], 5000, 0, scale), [])

    def test_a_film_is_of_whoever_shows_their_head_most(self) -> None:
        camera = dict(fx=900.0)

        def person(id_: int, distance: float, head: int) -> dict:
            return dict(id=id_, stature=1.7, joints3d=[[0.0, 0.0, distance]] * NB, visibility=[head, 1] + [1] * (NB - 2))

        # 510 px, head hidden twice; 510 px; too far away
        frames = [dict(camera=camera, people=[person(1, 3.0, int(k < 3)), person(2, 3.0 + k / 100, 1), person(3, 30.0, 1)]) for k in range(5)]
        chosen = most_seen(frames, 300)
        assert chosen
        self.assertEqual((chosen[0]["id"], chosen[0]["joints3d"][0][2]), (2, 3.02))
        self.assertIsNone(most_seen(frames, 900))


class Tiles(unittest.TestCase):
    def test_depth_labels_turn_with_the_picture(self) -> None:
        """Seen from far away, a bone's x and y are its pixels over a scale, however the tile is turned; some tiles lie on their side."""
        g = torch.Generator().manual_seed(5)
        rel = torch.randn(1, 1, 21, 3, generator=g) * 0.3
        rel = rel - rel[:, :, ROOT : ROOT + 1]
        pixels = 40.0
        data = dict(
            image=torch.zeros(1, 3, 96, 96, dtype=torch.uint8),
            joints2d=rel[:, :, :NJ, :2] * pixels + 48,
            visible=torch.ones(1, 1, NJ, dtype=torch.uint8),
            joints3d=rel + torch.tensor([0.0, 0.0, 9.0]),
            rel3d=rel,
            size_px=torch.full((1, 1), 68.0),
        )
        t = Pool(data, 1, seed=3).draw(400, 96, 96, zoom=(1.0, 1.0))
        seen = (t.joints2d - t.joints2d[:, :, 1:2]) / pixels
        told = (t.rel3d[:, :, :NJ] - t.rel3d[:, :, 1:2])[..., :2]
        self.assertLess(float((seen - told).abs().max()), 1e-4)
        up = told[:, 0, 0] / told[:, 0, 0].norm(dim=-1, keepdim=True)
        own = (rel[0, 0, 0] - rel[0, 0, 1])[:2]
        own = own / own.norm()
        mirrored = own * torch.tensor([-1.0, 1.0])
        turned = torch.maximum((up @ own), (up @ mirrored)) < 0.7
        self.assertGreater(int(turned.sum()), 10)
        self.assertLess(int(turned.sum()), 70)


    def test_close_people_are_as_large_as_asked_and_show_their_heads(self) -> None:
        for side in (256, 1024):  # what is rendered larger may come closer
            joints = torch.full((1, 1, NJ, 2), 0.5 * side) + torch.linspace(-0.4, 0.4, NJ)[:, None] * torch.tensor([0.0, side])
            data = dict(
                image=torch.zeros(1, 3, side, side, dtype=torch.uint8),
                joints2d=joints,
                visible=torch.ones(1, 1, NJ, dtype=torch.uint8),
                joints3d=torch.randn(1, 1, NB, 3) + torch.tensor([0.0, 0.0, 9.0]),
                rel3d=torch.randn(1, 1, NB, 3),
                size_px=torch.full((1, 1), 0.8 * side),
            )
            t = Pool(data, 1, seed=3).draw(200, 96, 96, zoom=(0.5, 2.0), roll=0.0, close=(200.0, 600.0))
            most = min(600.0, 1.6 * side)
            self.assertTrue(bool(((t.size_px > 199) & (t.size_px < most + 1)).all()))
            self.assertGreater(float(t.size_px.max()), 0.9 * most)
            self.assertGreater(float(t.visible[:, 0, 0].float().mean()), 0.5)


class Lifting(unittest.TestCase):
    def test_procrustes_undoes_a_similarity(self) -> None:
        x = torch.randn(5, 21, 3)
        r = torch.linalg.qr(torch.randn(5, 3, 3))[0]
        r = r * torch.det(r).sign()[:, None, None]
        self.assertLess(float((procrustes(x @ r * 1.7 + 3, x) - x).abs().max()), 1e-3)

    def test_bones_chain_to_the_person(self) -> None:
        rel = torch.randn(6, 21, 3)
        rel = rel - rel[:, ROOT : ROOT + 1]
        bones = (rel - rel[:, PARENTS21]).flatten(1)[:, None].expand(-1, NJ, -1)
        self.assertLess(errors(naive(torch.ones(6, NJ), bones * channel_mask()), rel)["mpjpe"], 0.1)

    def test_input_knows_neither_place_nor_size(self) -> None:
        uv, conf, enc = torch.randn(3, NJ, 2) * 40, torch.rand(3, NJ) + 0.1, torch.randn(3, NJ, 63)
        a = stage2_input(uv, conf, enc, channel_mask())
        b = stage2_input(uv * 2.5 + 90, conf, enc, channel_mask())
        self.assertEqual(tuple(a.shape), (3, 924))
        self.assertLess(float((a - b).abs().max()), 1e-3)

    def test_unseen_joints_are_zero(self) -> None:
        g = torch.Generator().manual_seed(1)
        uv, conf, enc = imitate(torch.randn(300, NJ, 2) * 40, torch.randn(300, 21, 3) * 0.3, g, channel_mask())
        x = stage2_input(uv, conf, enc, channel_mask()).view(300, NJ, 66)
        gone = conf == 0
        self.assertGreater(int(gone.sum()), 20)
        self.assertEqual(float(x[gone].abs().max()), 0.0)
        self.assertTrue(bool((conf[:, 1] > 0).all()))  # nobody is found without a neck


    def test_limbs_taken_for_each_other_bring_each_other_s_encodings(self) -> None:
        g = torch.Generator().manual_seed(3)
        rel = torch.randn(1, 21, 3).expand(4000, -1, -1) * 0.3
        uv = torch.randn(1, NJ, 2).expand(4000, -1, -1) * 40
        noisy, conf, enc = imitate(uv, rel, g, channel_mask())
        elbow, other = 3, 6
        swapped = (noisy[:, elbow] - uv[:, other]).norm(dim=1) < 0.2 * (uv[:, elbow] - uv[:, other]).norm(dim=1)
        swapped &= (noisy[:, other] - uv[:, elbow]).norm(dim=1) < 0.2 * (uv[:, elbow] - uv[:, other]).norm(dim=1)
        self.assertGreater(int(swapped.sum()), 20)
        bone = rel[0] - rel[0, PARENTS21]
        said = enc.view(4000, NJ, NB, 3)[swapped][:, elbow, elbow].median(0).values
        self.assertLess(float((said - bone[other]).norm()), float((said - bone[elbow]).norm()))


class Upright:
    """A body that stands: 21 joints in body space (x left, y up, z forward), of somebody 1.70 m tall, turned as asked."""

    JOINTS = (
        [[0, 1.68, 0], [0, 1.45, 0]]
        + [[s * x, y, 0] for s in (-1, 1) for x, y in ((0.18, 1.4), (0.25, 1.12), (0.28, 0.87))]
        + [[s * 0.1, y, 0] for s in (-1, 1) for y in (0.9, 0.48, 0.08)]
        + [[0, 0.95, 0], [0, 1.15, 0], [0, 1.55, 0], [-0.28, 0.78, 0], [0.28, 0.78, 0], [-0.1, 0.02, 0.15], [0.1, 0.02, 0.15]]
    )

    def random_shapes(self, n: int, g: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        return torch.zeros(n, 1), 1.5 + 0.4 * torch.rand(n, generator=g)

    def shaped(self, w: torch.Tensor, stature: torch.Tensor, with_verts: bool = True) -> tuple[None, torch.Tensor]:
        return None, torch.tensor(self.JOINTS) * (stature / 1.7)[:, None, None]

    def random_poses(self, *_: object, **__: object) -> None:
        return None

    def kinematics(self, q: None, rest: torch.Tensor, yaw: torch.Tensor) -> tuple[None, None, torch.Tensor]:
        c, s = yaw.cos()[:, None], yaw.sin()[:, None]
        x, y, z = rest.unbind(-1)
        return None, None, torch.stack([c * x + s * z, y, c * z - s * x], -1)


class Packed(unittest.TestCase):
    def test_photos_are_upright_whoever_decodes_them(self) -> None:
        turned = Image.Exif()
        turned[0x0112] = 6
        file = io.BytesIO()
        Image.new("RGB", (40, 20)).save(file, "JPEG", exif=turned)
        self.assertEqual(real.decode(file.getvalue()).shape, (40, 20, 3))
        with mock.patch.dict(sys.modules, cv2=None):
            upright = real.decode(file.getvalue())
        self.assertEqual(upright.shape, (40, 20, 3))
        upright[0, 0] = 7  # may be written to

    def test_decoded_pictures_of_another_pack_are_not_taken(self) -> None:
        names = {real.cached_name(files, 200) for files in ([b"one", b"two"], [b"one", b"too"], [b"one", b"two"])}
        self.assertEqual(len(names), 2)

    def test_other_pictures_take_the_teacher_s_answers_away(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            data, out = pathlib.Path(d) / "data", pathlib.Path(d) / "pack"
            for folder in (data / "people2d/lspet", data / "no_people", out):
                folder.mkdir(parents=True)
            Image.new("RGB", (80, 60)).save(data / "people2d/lspet/1.jpg")
            row = dict(file="lspet/1.jpg", split="train", joints=[[79, 59, 1]] * NJ)
            (data / "people2d/annotations.json").write_text(json.dumps([row]))
            (out / "teacher.npz").touch()
            pack.pack_images(data, out, 40, 50, False)
            self.assertFalse((out / "teacher.npz").exists())
            z = np.load(out / "images.npz")
            self.assertEqual(z["size"].tolist(), [[30, 40]])
            np.testing.assert_allclose(z["joints"][0, 0], [39.25, 29.25, 1])


class PeopleBeforeACamera(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.people = People3D.__new__(People3D)
        cls.people.body, cls.people.device, cls.people.held = Upright(), torch.device("cpu"), True
        cls.people.clips, cls.people.g = None, torch.Generator().manual_seed(1)

    def test_some_stand_right_before_it_and_are_cut_off(self) -> None:
        uv, rel, size, inside = self.people.sample(4000)
        self.assertEqual([tuple(t.shape) for t in (uv, rel, size, inside)], [(4000, NJ, 2), (4000, NB, 3), (4000,), (4000, NJ)])
        self.assertTrue(bool(inside[:, 1].all()) and int(inside.sum(1).min()) >= 4)
        self.assertGreater(float((size > 400).float().mean()), 0.1)
        close = inside[size > 400]
        self.assertGreater(float((~close[:, 8:].any(1)).float().mean()), 0.1)
        self.assertGreater(float(inside[size < 200].float().mean()), 0.95)


class RenderedScenes(unittest.TestCase):
    def test_photos_with_truth_are_no_scenes(self) -> None:
        """They come in the same format, and what is packed as scenes counts as open."""
        codes = np.full(NJ, VISIBLE)
        with tempfile.TemporaryDirectory() as folder:
            pictures, out = pathlib.Path(folder) / "photos", pathlib.Path(folder) / "scenes"
            pictures.mkdir()
            Image.new("RGB", (512, 320)).save(pictures / "000000.jpg")
            camera = dict(fx=512, fy=512, cx=255.5, cy=159.5)
            frames = [dict(file="000000.jpg", camera=camera, people=[person(1, PERSON, codes)])]
            (pictures / "truth.json").write_text(json.dumps(dict(format="edgecap-truth", version=1, frames=frames)))
            with self.assertRaisesRegex(SystemExit, "no scenes"):
                truth.main([str(pictures), str(out)])
            self.assertFalse(out.exists())

    def test_what_ends_halfway_leaves_no_scenes_of_before(self) -> None:
        joints = [[0.01 * j, 0.02 * j, 4.0] for j in range(NB)]
        seen = dict(stature=1.7, joints3d=joints, joints2d=[[9.0, 9.0]] * NB, visibility=[VISIBLE] * NB)
        camera = dict(fx=400.0, fy=400.0, cx=256.0, cy=160.0)
        with tempfile.TemporaryDirectory() as folder:
            synth, out = pathlib.Path(folder) / "synth", pathlib.Path(folder) / "scenes"
            synth.mkdir()
            files = [f"{k}.png" for k in range(2)]
            frames = [dict(file=name, camera=camera, people=[seen]) for name in files]
            (synth / "truth.json").write_text(json.dumps(dict(format="edgecap-truth", version=1, frames=frames)))
            for name in files:
                Image.new("RGB", (512, 320)).save(synth / name)
            truth.main([str(synth), str(out)])
            self.assertEqual(Stored(out, 1).filled, 2)
            (synth / files[1]).write_bytes(b"no picture")
            with self.assertRaises(OSError):
                truth.main([str(synth), str(out)])
            self.assertFalse(terms.is_open(out))
            with self.assertRaisesRegex(SystemExit, "expected scenes in .*scenes, found none"):
                Stored(out, 1)

    def test_scenes_are_counted_anew_where_others_are_rendered(self) -> None:
        """What is rendered lacks the last field, so the first ones are replaced and nothing is counted."""
        halves = mock.Mock(render=lambda n: mock.Mock(spec=FIELDS[:1], **{FIELDS[0]: torch.zeros(n, 1)}))
        with tempfile.TemporaryDirectory() as folder, mock.patch("prerender.Generator", lambda *_, **__: halves), mock.patch("prerender.load_photos"):
            out = pathlib.Path(folder)
            (out / "filled").write_text("1500")
            with self.assertRaises(AttributeError):
                prerender.main([str(out), str(out), "--n", "4"])
            self.assertTrue((out / f"{FIELDS[0]}.npy").exists())
            with self.assertRaises(SystemExit):
                Stored(out, 1)

    def test_everybody_of_the_fullest_picture_has_a_place(self) -> None:
        joints3d = [[0.01 * j, 0.02 * j, 4.0] for j in range(NB)]
        joints2d = [[256 + 400 * p[0] / p[2], 160 + 400 * p[1] / p[2]] for p in joints3d]
        seen = dict(stature=1.7, joints3d=joints3d, joints2d=joints2d, visibility=[VISIBLE] * NB)
        unseen = seen | dict(visibility=[OUTSIDE] * NB)
        camera = dict(fx=400.0, fy=400.0, cx=256.0, cy=160.0)
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "scenes"
            synths = []
            for name, blue, crowds in (("one", 199, (2, 9)), ("other", 40, (1,))):
                synth = pathlib.Path(folder) / name
                synth.mkdir()
                Image.new("RGB", (512, 320), (9, 99, blue)).save(synth / "000000.png")
                frames = [dict(file="000000.png", camera=camera, people=n * [seen] + [unseen]) for n in crowds]
                (synth / "truth.json").write_text(json.dumps(dict(format="edgecap-truth", version=1, frames=frames)))
                synths.append(synth)
            subprocess.run([sys.executable, KIT / "truth.py", *synths, out], check=True, capture_output=True)
            pool = Stored(out, 1)
            self.assertTrue(terms.is_open(out))
            self.assertEqual((pool.data["size_px"] > 0).sum(1).tolist(), [2, 9, 1])
            self.assertEqual(pool.data["image"][:, 2, 7, 7].tolist(), [199, 199, 40])
            tiles = pool.draw(4, 320, 512, (1.0, 1.0), roll=0.0)
            self.assertEqual(tiles.joints2d.shape, (4, 9, NJ, 2))
            self.assertTrue(bool((tiles.visible.eq(VISIBLE).all(-1).sum(1)[:, None] == torch.tensor([2, 9, 1])).any(1).all()))


class Company(unittest.TestCase):
    def setUp(self) -> None:
        self.n = torch.arange(1, 5).repeat(500)
        self.tall, self.cx, self.cy = arrange(self.n, 4, (100, 300), torch.Generator().manual_seed(3))

    def test_who_is_taller_is_pasted_over_the_others(self) -> None:
        for k in range(2, 5):
            tall = self.tall[self.n == k, :k]
            self.assertTrue((tall[:, 1:] >= tall[:, :-1]).all())
            ratio = tall[:, -1] / tall[:, 0]
            self.assertGreater(float(ratio.max()), 1.9)  # behind each other
            self.assertLess(float(ratio.median()), 1.6)  # but mostly beside each other

    def test_somebody_alone_is_as_tall_as_asked_for_and_near_the_middle(self) -> None:
        alone = self.n == 1
        tall = self.tall[alone, 0]
        self.assertTrue(((tall >= 100) & (tall <= 300)).all())
        self.assertTrue(((self.cx[alone, 0] - 0.5).abs() <= 0.3).all() and ((self.cy - 0.5).abs() <= 0.225).all())

    def test_most_stand_in_a_row_and_some_close_together(self) -> None:
        x = self.cx[self.n == 4].sort(1)[0]
        width = x[:, -1] - x[:, 0]
        self.assertGreater(float(width.quantile(0.7)), 0.6)
        self.assertLess(float(width.quantile(0.15)), 0.5)


class PosedPeople(unittest.TestCase):
    def person(self, x: float, n: int) -> dict[str, object]:
        joints3d = [[x + 0.01 * j, 0.02 * j, 4.0 + 0.001 * n] for j in range(21)]
        joints2d = [[256 + 400 * p[0] / p[2], 160 + 400 * p[1] / p[2]] for p in joints3d]
        return dict(stature=1.7, joints3d=joints3d, joints2d=joints2d, visibility=[1] * 18 + [0] * 3)

    def load(self, people: list[dict[str, object]]) -> Posed:
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "truth.json"
            frames = [dict(camera=dict(fx=400.0), people=[p]) for p in people]
            path.write_text(json.dumps(dict(format="edgecap-truth", version=1, frames=frames)))
            return Posed(path, torch.device("cpu"), 1)

    def test_those_measured_with_are_never_drawn(self) -> None:
        posed = self.load([self.person(0.3, n) for n in range(100)])
        self.assertEqual(len(posed), 100)
        held = {round(float(s), 4) for s in posed.held()[2]}
        drawn = {round(float(s), 4) for s in posed.sample(4000)[2]}
        self.assertEqual((len(held), len(drawn)), (7, 93))
        self.assertFalse(held & drawn)

    def test_mirror_images_are_people_too(self) -> None:
        posed = self.load([self.person(0.3, n) for n in range(32)])
        uv, rel, _, inside = posed.sample(200)
        turned = uv[:, 1, 0] < 0
        self.assertTrue(0.3 < float(turned.float().mean()) < 0.7)
        self.assertEqual((rel[:, 2, 0] > rel[:, 5, 0]).tolist(), [False] * 200)  # the right shoulder stays right of the left one
        lean = rel[:, 0, 0] - rel[:, ROOT, 0]
        self.assertTrue(bool(((lean > 0) == turned).all()))
        self.assertTrue(bool(inside.all()))

    def test_who_is_hardly_in_the_picture_is_left_out(self) -> None:
        gone = self.person(0.3, 1) | dict(visibility=[1, 0] + [1] * 19)  # without a neck
        few = self.person(0.3, 2) | dict(visibility=[1, 1, 1] + [0] * 18)
        enough = [self.person(0.3, n) for n in range(3, 23)]
        self.assertEqual(len(self.load([gone, few, *enough])), 20)
        with self.assertRaisesRegex(SystemExit, "expected more than 16 people of 4 joints"):
            self.load([gone, few] * 10)


class Files(unittest.TestCase):
    def test_weights_come_back(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            path = pathlib.Path(d) / "w.safetensors"
            net = SelecSLSNet().eval()
            weights.write(path, export.slim(net.state_dict(), f32=True), {"contract": json.dumps({"step": 3})})
            other = SelecSLSNet().eval()
            meta = weights.load_into(other, path)
            x = torch.randn(1, 3, 64, 64)
            with torch.no_grad():
                for a, b in zip(net(x), other(x)):
                    self.assertTrue(torch.equal(a, b))
            self.assertEqual(json.loads(meta["contract"]), {"step": 3})
            with self.assertRaises(SystemExit):
                weights.load_into(Stage2(), path)
            path.write_bytes(path.read_bytes()[:100])
            with self.assertRaises(SystemExit):
                weights.read(path)

    def test_unsupervised_channels_cannot_reach_the_answer(self) -> None:
        with tempfile.TemporaryDirectory() as d:
            path = pathlib.Path(d) / "s.safetensors"
            export.export_stage2(Stage2().eval(), {"step": 1, "report": {}}, path, f32=True)
            s2 = Stage2()
            weights.load_into(s2, path)
            uv, conf, enc = torch.randn(5, NJ, 2) * 50, torch.rand(5, NJ), torch.randn(5, NJ, 63)
            with torch.no_grad():
                a, b = (s2.eval()(stage2_input(uv, conf, enc, m)) for m in (channel_mask(), torch.ones(NJ, 63)))
            self.assertTrue(torch.allclose(a, b, atol=1e-5))


class Optimiser(unittest.TestCase):
    def test_updates_keep_directions_and_lose_strengths(self) -> None:
        torch.manual_seed(3)
        for shape in ((2, 24, 40), (1, 40, 24), (3, 16, 200), (2, 96, 8)):
            m = torch.randn(shape)
            u, strengths, vt = torch.linalg.svd(m, full_matrices=False)
            self.assertGreater(float((strengths[:, 0] / strengths[:, -1]).min()), 1.5)
            o = orthogonal(m).float()
            inside = u.mT @ o @ vt.mT  # diagonal where the singular vectors are the same
            kept = inside.diagonal(dim1=1, dim2=2)
            self.assertTrue(bool(((kept > 0.6) & (kept < 1.3)).all()), kept)
            self.assertLess(float((inside - torch.diag_embed(kept)).abs().max()), 0.05)

    def test_updates_stay_small_where_most_directions_are_weak(self) -> None:
        torch.manual_seed(5)
        for shape in ((2, 64, 288), (4, 24, 288), (1, 24, 30)):
            for weakest in (1e-2, 1e-4, 1e-6, 0.0):
                u, strengths, vt = torch.linalg.svd(torch.randn(shape), full_matrices=False)
                strengths = torch.logspace(0, -6, shape[1]).clamp_min(weakest) * (torch.arange(shape[1]) < (3 if weakest == 0 else shape[1]))
                for fast in (True, False):
                    with mock.patch.object(muon, "bf16_pays", lambda _, fast=fast: fast):
                        o = orthogonal(u * strengths @ vt).float()
                    self.assertLess(float(torch.linalg.svdvals(o).max()), 1.3, (shape, weakest, fast))

    def _two_layers(self) -> tuple[torch.nn.Sequential, Muon]:
        torch.manual_seed(4)
        net = torch.nn.Sequential(torch.nn.Conv2d(8, 8, 3, padding=1, groups=2), torch.nn.Conv2d(8, 4, 1))
        net = net.to(memory_format=torch.channels_last)
        first = net[0].weight
        rest = [p for p in net.parameters() if p is not first]
        return net, Muon([(first, 2)], [dict(params=rest, weight_decay=0.0)], lr=0.02, wd=0.0, fused=True)

    def _fit(self, net: torch.nn.Sequential, opt: torch.optim.Optimizer, steps: int) -> float:
        torch.manual_seed(5)
        x, y = torch.randn(4, 8, 6, 6), torch.randn(4, 4, 6, 6)
        for _ in range(steps):
            opt.zero_grad()
            loss = (net(x) - y).square().mean()
            loss.backward()
            opt.step()
        return float(loss.detach())

    def test_every_parameter_learns(self) -> None:
        net, opt = self._two_layers()
        before = [p.detach().clone() for p in net.parameters()]
        start, end = self._fit(net, opt, 1), self._fit(net, opt, 60)
        self.assertLess(end, 0.8 * start)
        for p, was in zip(net.parameters(), before):
            self.assertGreater(float((p.detach() - was).abs().max()), 1e-3)

    def test_a_step_is_as_long_as_the_rate_says(self) -> None:
        net, opt = self._two_layers()
        was = net[0].weight.detach().clone()
        self._fit(net, opt, 1)
        length = float((net[0].weight.detach() - was).square().mean().sqrt())
        self.assertAlmostEqual(length, 0.02 * 0.2, delta=0.02 * 0.2 * 0.25)

    def test_the_momentum_survives_a_checkpoint(self) -> None:
        net, opt = self._two_layers()
        self._fit(net, opt, 5)
        with tempfile.TemporaryDirectory() as d:
            folder = pathlib.Path(d) / "ckpt"
            checkpoint.save(folder, net, net, opt, {"step": 5})
            other, again = self._two_layers()
            checkpoint.load(folder, other, other, again, torch.device("cpu"))
            third, cold = self._two_layers()
            checkpoint.load(folder, third, third, None, torch.device("cpu"))
        for p, q in zip(net.parameters(), other.parameters()):
            self.assertEqual(set(opt.state[p]), set(again.state[q]))
            m = opt.state[p]["exp_avg"]
            self.assertLess(float((m - again.state[q]["exp_avg"]).abs().max()), 1e-3 * float(m.abs().max()))
        on, taken_up, forgotten = self._fit(net, opt, 4), self._fit(other, again, 4), self._fit(third, cold, 4)
        self.assertLess(abs(taken_up - on), 0.2 * abs(forgotten - on))

    def test_a_run_goes_on_with_either_optimizer(self) -> None:
        net, opt = self._two_layers()
        self._fit(net, opt, 5)
        with tempfile.TemporaryDirectory() as d:
            folder = pathlib.Path(d) / "ckpt"
            checkpoint.save(folder, net, net, opt, {"step": 5})
            other, _ = self._two_layers()
            adam = torch.optim.AdamW(other.parameters(), lr=1e-3, fused=True)
            checkpoint.load(folder, other, other, adam, torch.device("cpu"))
            self.assertNotIn(other[0].weight, adam.state, "the momentum alone is no state of Adam's")
            self.assertIn(other[1].weight, adam.state)
            before = other[0].weight.detach().clone()
            self._fit(other, adam, 3)
            self.assertGreater(float((other[0].weight.detach() - before).abs().max()), 0)
            checkpoint.save(folder, other, other, adam, {"step": 8})
            third, back = self._two_layers()
            checkpoint.load(folder, third, third, back, torch.device("cpu"))
        self.assertEqual(set(back.state[third[0].weight]), {"exp_avg"})
        self._fit(third, back, 1)


class Network(unittest.TestCase):
    def test_skipping_the_3d_head_changes_nothing_else(self) -> None:
        net = SelecSLSNet().eval()
        x = torch.randn(3, 3, 64, 96)
        with torch.no_grad():
            y, e = net(x)
            y2, e2 = net(x, 2)
        self.assertEqual(tuple(y.shape), (3, 40, 8, 12))
        self.assertEqual(tuple(e2.shape), (1, 63, 8, 12))
        self.assertTrue(torch.allclose(y, y2, atol=1e-5) and torch.allclose(e[2:], e2, atol=1e-5))


class Normalisation(unittest.TestCase):
    def pair(self) -> tuple[BatchRenorm2d, torch.nn.BatchNorm2d]:
        torch.manual_seed(3)
        ours, theirs = BatchRenorm2d(5), torch.nn.BatchNorm2d(5)
        torch.nn.init.uniform_(theirs.weight, 0.5, 2)
        torch.nn.init.normal_(theirs.bias)
        ours.load_state_dict(theirs.state_dict())
        return ours, theirs

    def test_training_answers_as_the_running_statistics_do(self) -> None:
        ours, theirs = self.pair()
        ours.momentum = 0.5
        for _ in range(20):
            ours(torch.randn(8, 5, 12, 12) * 2 + 1)
        fixed = theirs.eval()
        fixed.load_state_dict(ours.state_dict())
        x = torch.randn(2, 5, 12, 12) * 4 - 1  # twice as wide as the others and shifted: within the limits
        self.assertLess(float((ours(x) - fixed(x)).abs().max()), 1e-4)
        theirs.train()
        self.assertGreater(float((theirs(x) - ours.eval()(x)).abs().max()), 1)

    def test_what_is_far_off_is_bounded(self) -> None:
        ours, _ = self.pair()
        y = (ours(100 * torch.randn(4, 5, 32, 32) + 1000) - ours.bias[:, None, None]) / ours.weight[:, None, None]
        self.assertAlmostEqual(float(y.std()), LIMITS[0], delta=0.02)
        self.assertAlmostEqual(float(y.mean()), LIMITS[1], delta=0.02)

    def test_statistics_and_fixed_answers_are_those_of_batch_normalisation(self) -> None:
        ours, theirs = self.pair()
        for _ in range(3):
            x = torch.randn(4, 5, 6, 6) * 3 + 2
            ours(x), theirs(x)
        for name in ("running_mean", "running_var"):
            self.assertLess(float((getattr(ours, name) - getattr(theirs, name)).abs().max()), 1e-5)
        self.assertLess(float((ours.eval()(x) - theirs.eval()(x)).abs().max()), 1e-5)

    def test_the_network_uses_it_everywhere(self) -> None:
        kinds = [type(m) for m in SelecSLSNet().modules() if isinstance(m, torch.nn.BatchNorm2d)]
        self.assertEqual(set(kinds), {BatchRenorm2d})


class FakeQuantisation(unittest.TestCase):
    def test_channels_have_ranges_of_their_own_and_7_bits(self) -> None:
        relu = quant.QuantReLU(3)
        x = torch.linspace(-1, 1, 4000).view(2, 1, 40, 50) * torch.tensor([8.0, 2.0, 0.0])[None, :, None, None]
        relu.train()(x)
        y = relu.eval()(x)
        # the layer's range, the mean of it and the channel's own, and next to nothing
        steps = torch.tensor([8.0, 4.0, 0.8]) / 127
        levels = y / steps[None, :, None, None]
        torch.testing.assert_close(levels, levels.round(), atol=1e-4, rtol=0)
        self.assertLessEqual(float((y - x.relu()).abs().amax((0, 2, 3)).sub(steps / 2).max()), 1e-6)
        self.assertEqual(len(y[:, 0].unique()), 128)
        self.assertEqual(float(y[:, 2].abs().max()), 0.0)

    def test_a_wild_picture_does_not_stretch_the_ranges(self) -> None:
        relu = quant.QuantReLU(2).train()
        x = torch.ones(5, 2, 4, 4) * torch.tensor([1.0, 0.5])[:, None, None]
        x[3] *= 50
        relu(x)
        self.assertEqual(relu.amax.tolist(), [1.0, 0.5])
        relu(x[:1] * 0.1)
        torch.testing.assert_close(relu.amax, torch.tensor([0.95, 0.475]))

    def test_pictures_that_are_no_numbers_leave_the_ranges_as_they_are(self) -> None:
        relu = quant.QuantReLU(2).train()
        x = torch.ones(5, 2, 4, 4) * torch.tensor([1.0, 0.5])[:, None, None]
        for bad in (torch.nan, torch.inf):
            x[3, 1, 2, 2] = bad
            relu(x)
            self.assertEqual(relu.amax.tolist(), [1.0, 0.5])
            relu(x[3:4])
            self.assertEqual(relu.amax.tolist(), [1.0, 0.5], "nothing was seen, so nothing is forgotten")

    def test_gradients_pass_what_is_rounded_and_not_what_is_clipped(self) -> None:
        relu = quant.QuantReLU(1)
        relu.amax.fill_(1.0)
        x = torch.tensor([-0.5, 0.3, 1.5]).view(1, 1, 1, 3).requires_grad_()
        relu.eval()(x).sum().backward()
        self.assertEqual(x.grad.flatten().tolist(), [0.0, 1.0, 0.0])

    def test_every_activation_of_the_network_is_rounded_and_comes_back(self) -> None:
        torch.manual_seed(4)
        net = quant.prepare(SelecSLSNet())
        self.assertFalse([n for n, m in net.named_modules() if isinstance(m, torch.nn.ReLU)])
        net.train()(torch.rand(2, 3, 64, 64) - 0.5)
        ranges = quant.ranges(net)
        self.assertTrue(all(r > 0 for r in ranges.values()))
        other = quant.prepare(SelecSLSNet())
        other.load_state_dict(net.state_dict())
        self.assertEqual(quant.ranges(other), ranges)


class Card(unittest.TestCase):
    def test_a_row_says_what_was_measured_and_no_more(self) -> None:
        finding = [dict(recall=0.9, people=20, precision=0.8, mean_oks=0.7), dict(recall=0.855, people=20, precision=0.8, mean_oks=0.75)]
        pose = dict(mpjpe_mm=157.24, canonical_mpjpe_mm=150.0, n_mpjpe_mm=140.0, pa_mpjpe_mm=119.0, people=17)
        full = card.row("stills", dict(finding=finding, coco=dict(ap=0.485, ar=0.52), pck=0.762, pose3d=pose, identity=dict(idf1=0.93, switches=2)))
        self.assertEqual(
            full,
            "| stills | 85.5 (90.0) % of 20, 80.0 % right | 48.5 / 52.0, 0.75 | 76.2 % | 157.2 / 150.0 / 140.0 / 119.0 mm of 17 | IDF1 93.0 %, 2 switches |",
        )
        self.assertEqual(card.without(["--quality=best"], "--quality"), [])
        self.assertEqual(card.without(["--threads", "1", "--quality", "best", "--flip-test"], "--quality"), ["--threads", "1", "--flip-test"])
        self.assertEqual(card.row("LSP-test", dict(finding=[], pck=0.824)), "| LSP-test | – | – | 82.4 % | – |  |")
        self.assertEqual(card.row("nobody", dict(finding=[], quiet=dict(quiet=98, pictures=100))), "| nobody | quiet 98 of 100 | | | | |")


    def test_what_was_measured_is_kept_where_the_next_set_fails(self) -> None:
        two = [card.Pictures(name, name, []) for name in ("one", "two")]

        def program(what: str, *options: object) -> str:
            if what == "infer" and "two" in options:
                raise SystemExit("no pictures")
            return json.dumps(dict(finding=[], pck=0.5))

        with tempfile.TemporaryDirectory() as d, mock.patch("card.prepare"), mock.patch("card.sets", return_value=two):
            kept = pathlib.Path(d) / "kept.json"
            with mock.patch("card.Program", return_value=program), self.assertRaisesRegex(SystemExit, "no pictures"):
                card.main([d, "--data", d, "--json", str(kept)])
            self.assertEqual(list(json.loads(kept.read_text())), ["one"])

    def test_weights_are_measured_by_the_thresholds_fitted_to_them(self) -> None:
        a = argparse.Namespace(stage1="a", stage2="b", association=None, calibrate="photos", size=[160, 224])
        self.assertNotIn("--association", choices.conversion(a, [], pathlib.Path("c.ecm")))
        a.association = "open.toml"
        asked = choices.conversion(a, ["--range", "max"], pathlib.Path("c.ecm"))
        self.assertEqual(asked[asked.index("--association") + 1], "open.toml")


class Frames(unittest.TestCase):
    def test_letterbox_and_back(self) -> None:
        image = np.zeros((300, 200, 3), np.uint8)
        image[150, 100] = 255  # one bright pixel
        x, s, du, dv = letterbox(image)
        y, c = np.unravel_index(int(x[0, 0, :, :].sub(128).clamp_min(-128).where(x[0, 0] != 128, torch.tensor(-200.0)).argmax()), (320, 512))
        q = np.ones((14, 3), np.float32) * [c, y, 1]
        back = to_original([q], s, du, dv)[0]
        self.assertLess(abs(back[0, 0] - 100), 1.0)
        self.assertLess(abs(back[0, 1] - 150), 1.0)

    def test_oks(self) -> None:
        q = np.concatenate([PERSON, np.ones((14, 1), np.float32)], 1)
        k = np.concatenate([PERSON[photos.SHARED], np.full((12, 1), 2, np.float32)], 1)
        p = photos.Person(k, 150.0 * 60, np.array([0, 0, 60, 150], np.float32))
        self.assertAlmostEqual(photos.oks(q, p), 1.0, places=5)
        q[photos.SHARED[:6], 2] = 0  # arms not found
        self.assertAlmostEqual(photos.oks(q, p), 0.5, places=5)


class Time(unittest.TestCase):
    def seconds(self, *gaps: float) -> float:
        """What counts of a run whose start takes the first of these gaps and whose steps take the others."""
        at = iter(np.cumsum([1000.0, *gaps]).tolist())
        with mock.patch("clock.time.monotonic", lambda: next(at)):
            c = clock.Clock()
            c.whole()
            for _ in gaps[1:]:
                c.step()
        return c.seconds

    def test_of_a_pause_no_more_counts_than_a_step_may_take(self) -> None:
        self.assertEqual(self.seconds(500, 1, 1, 1), 503)
        self.assertEqual(self.seconds(500, 1, 1, 40000, 1), 503 + clock.ALLOWED)
        self.assertEqual(self.seconds(0, 30, 30, 30, 40000, 30), 120 + 30 * clock.LONGEST)
        self.assertEqual(self.seconds(0, 1, 1, clock.ALLOWED, 1), 3 + clock.ALLOWED, "algorithms that are chosen are no pause")


class Ranks(unittest.TestCase):
    def test_two_processes_agree(self) -> None:
        code = (
            "import torch, ranks\n"
            "children = ranks.launch(2)\n"
            "g = ranks.Group(2)\n"
            "t = [torch.full((3,), 1.0 + 2 * g.rank), torch.full((2, 2), 4.0 * g.rank)]\n"
            "g.average(t)\n"
            "assert g.same([7.0 + g.rank]) == [7.0]\n"
            "assert t[0].tolist() == [2.0] * 3 and t[1].flatten().tolist() == [2.0] * 4, t\n"
            "print('agreed', flush=True)\n"
            "[c.wait() for c in children]\n"
        )
        with tempfile.TemporaryDirectory() as d:
            script = pathlib.Path(d) / "two.py"
            script.write_text(code)
            env = os.environ | {"PYTHONPATH": str(KIT)}
            r = subprocess.run([sys.executable, str(script)], env=env, capture_output=True, text=True, timeout=120, check=False)
        self.assertEqual(r.stdout.count("agreed"), 2, r.stderr)


if __name__ == "__main__":
    unittest.main()
