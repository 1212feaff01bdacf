//! Somebody with a skin on bones that move: bones, skin and motion go in, nodes of the file come out.

use glam::{DQuat, Mat4, Quat, Vec3};
use serde_json::json;

use super::document::{ARRAY_BUFFER, Document, ELEMENT_BUFFER, U8, U16, U32};

/// One bone at rest.
#[derive(Debug, Clone)]
pub struct Bone {
    /// What it is called.
    pub name: &'static str,
    /// The bone it hangs on, one before it; none of the first.
    pub parent: Option<usize>,
    /// Where it starts, metres.
    pub start: Vec3,
}

/// A mesh at rest and what moves it.
#[derive(Debug, Clone, Default)]
pub struct FigureSkin {
    /// Vertices, metres.
    pub positions: Vec<[f32; 3]>,
    /// Unit vectors outwards.
    pub normals: Vec<[f32; 3]>,
    /// Four bones a vertex.
    pub bones: Vec<[u8; 4]>,
    /// How much each counts, 1 in all.
    pub weights: Vec<[f32; 4]>,
    /// Three vertices a triangle, counter-clockwise seen from outside.
    pub triangles: Vec<u32>,
}

/// One person over time.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Who.
    pub id: u32,
    /// What the mesh is called.
    pub what: &'static str,
    /// The skeleton at rest.
    pub bones: Vec<Bone>,
    /// The mesh on it.
    pub skin: FigureSkin,
    /// Moments, rising seconds; of those that are the same as numbers the first is kept.
    pub times: Vec<f32>,
    /// Where the first bone is at each, metres.
    pub places: Vec<Vec3>,
    /// By bone, its local rotation at each.
    pub turns: Vec<Vec<DQuat>>,
    /// From when on they are there, and are not, seconds.
    pub presence: Vec<(f32, bool)>,
}

impl Document {
    /// Adds somebody and their motion.
    pub fn figure(&mut self, figure: &Figure) {
        let person = self.nodes.len();
        let first = person + 1;
        self.nodes.push(json!({
            "name": format!("person {}", figure.id),
            "children": [first],
        }));
        for (k, bone) in figure.bones.iter().enumerate() {
            let from = bone.parent.map_or(Vec3::ZERO, |p| figure.bones[p].start);
            let mut node = json!({
                "name": bone.name,
                "translation": (bone.start - from).to_array(),
            });
            let all = figure.bones.iter().enumerate();
            let carried = all.filter(|(_, b)| b.parent == Some(k));
            let children: Vec<usize> = carried.map(|(b, _)| first + b).collect();
            if !children.is_empty() {
                node["children"] = json!(children);
            }
            self.nodes.push(node);
        }
        let skinned = self.skinned(figure, first);
        self.roots.extend([person, skinned]);
        self.animate(figure, person);
    }

    /// Adds a mesh on the bones from node `first` on; its node.
    fn skinned(&mut self, figure: &Figure, first: usize) -> usize {
        let skin = &figure.skin;
        let binds = figure.bones.iter();
        let binds: Vec<f32> = binds
            .flat_map(|b| Mat4::from_translation(-b.start).to_cols_array())
            .collect();
        let binds = self.floats("MAT4", 16, &binds, None, false);
        let mut vertices = |kind, width, numbers: &[f32], bounds| {
            self.floats(kind, width, numbers, Some(ARRAY_BUFFER), bounds)
        };
        let position = vertices("VEC3", 3, skin.positions.as_flattened(), true);
        let normal = vertices("VEC3", 3, skin.normals.as_flattened(), false);
        let weights = vertices("VEC4", 4, skin.weights.as_flattened(), false);
        let (bones, count) = (skin.bones.as_flattened(), skin.bones.len());
        let joints = self.accessor("VEC4", U8, count, bones, Some(ARRAY_BUFFER), json!({}));
        // 65535 starts a new strip in some programs.
        let (kind, corners): (u32, Vec<u8>) = match u16::try_from(skin.positions.len()) {
            Ok(_) => {
                let short = skin.triangles.iter().map(|&c| c as u16);
                (U16, short.flat_map(u16::to_le_bytes).collect())
            }
            Err(_) => {
                let long = skin.triangles.iter();
                (U32, long.flat_map(|c| c.to_le_bytes()).collect())
            }
        };
        let count = skin.triangles.len();
        let target = Some(ELEMENT_BUFFER);
        let indices = self.accessor("SCALAR", kind, count, &corners, target, json!({}));
        self.materials.push(json!({
            "name": format!("person {}", figure.id),
            "pbrMetallicRoughness": {
                "baseColorFactor": colour(figure.id),
                "metallicFactor": 0.0,
                "roughnessFactor": 0.8,
            },
        }));
        let name = format!("{} {}", figure.what, figure.id);
        self.meshes.push(json!({
            "name": name,
            "primitives": [{
                "attributes": {
                    "POSITION": position, "NORMAL": normal, "JOINTS_0": joints, "WEIGHTS_0": weights,
                },
                "indices": indices,
                "material": self.materials.len() - 1,
            }],
        }));
        let bones: Vec<usize> = (first..first + figure.bones.len()).collect();
        self.skins.push(json!({
            "inverseBindMatrices": binds, "joints": bones, "skeleton": first,
        }));
        self.nodes.push(json!({
            "name": name,
            "mesh": self.meshes.len() - 1,
            "skin": self.skins.len() - 1,
        }));
        self.nodes.len() - 1
    }

    fn animate(&mut self, figure: &Figure, person: usize) {
        let kept = told_apart(&figure.times);
        let times: Vec<f32> = kept.iter().map(|&k| figure.times[k]).collect();
        let times = self.floats("SCALAR", 1, &times, None, true);
        let places = kept.iter().flat_map(|&k| figure.places[k].to_array());
        let places: Vec<f32> = places.collect();
        let places = self.floats("VEC3", 3, &places, None, false);
        self.channel(times, places, "LINEAR", person + 1, "translation");
        for (bone, turns) in figure.turns.iter().enumerate() {
            let mut before = Quat::IDENTITY;
            let turns = kept.iter().flat_map(|&k| {
                let q = turns[k].as_quat().normalize();
                // The nearer of the two signs: between two moments numbers are blended.
                before = if q.dot(before) < 0.0 { -q } else { q };
                before.to_array()
            });
            let turns: Vec<f32> = turns.collect();
            let turns = self.floats("VEC4", 4, &turns, None, false);
            self.channel(times, turns, "LINEAR", person + 1 + bone, "rotation");
        }
        let changes = figure.presence.iter();
        let (times, sizes): (Vec<f32>, Vec<[f32; 3]>) = changes
            .map(|(time, there)| (*time, [f32::from(u8::from(*there)); 3]))
            .unzip();
        let times = self.floats("SCALAR", 1, &times, None, true);
        let sizes = self.floats("VEC3", 3, sizes.as_flattened(), None, false);
        self.channel(times, sizes, "STEP", person, "scale");
    }
}

/// As different as can be for neighbours; the page shows the same hues.
fn colour(id: u32) -> [f32; 4] {
    let hue = (f64::from(id) * 0.618_034).fract() * 6.0;
    let part = |shift: f64| {
        let away = ((hue + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
        (0.25 + 0.6 * away.clamp(0.0, 1.0)) as f32
    };
    [part(0.0), part(4.0), part(2.0), 1.0]
}

/// Indices of the moments that are later than all before: the format wants times that rise, and days after the file's
/// first moment single floats are further apart than pictures.
fn told_apart(times: &[f32]) -> Vec<usize> {
    let mut latest = f32::NEG_INFINITY;
    let rises = |&k: &usize| {
        let later = times[k] > latest;
        latest = latest.max(times[k]);
        later
    };
    (0..times.len()).filter(rises).collect()
}

/// Joins moments at which somebody is or is not there to changes. `end`: when the last one is over, where others follow
/// without them; `None` where nothing follows: what a program shows after the last key stays for good.
pub fn presence(moments: impl Iterator<Item = (f32, bool)>, end: Option<f32>) -> Vec<(f32, bool)> {
    let mut changes: Vec<(f32, bool)> = Vec::new();
    let after = |changes: &[(f32, bool)], time: f32| {
        let last = changes.last().map_or(f32::NEG_INFINITY, |(last, _)| *last);
        time.max(last.next_up())
    };
    for (time, there) in moments {
        if changes.is_empty() && time > 0.0 {
            changes.push((0.0, false));
        }
        if changes.last().is_none_or(|(_, last)| *last != there) {
            changes.push((after(&changes, time), there));
        }
    }
    if let Some(end) = end {
        changes.push((after(&changes, end), false));
    }
    changes
}
