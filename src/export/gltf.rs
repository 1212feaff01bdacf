//! glTF 2.0 in one binary file: everybody as a skeleton with a skin, and one animation of all. Who is away has the size
//! 0.

use serde_json::{Value, json};

use super::error::ExportError;
use super::mannequin::{Mannequin, starts};
use super::motion::Motion;
use super::take::Take;
use crate::message::{HUMANOID_BONE_COUNT, HUMANOID_BONES};

const FLOAT: u32 = 5126;
const U16: u32 = 5123;
const U8: u32 = 5121;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_BUFFER: u32 = 34963;

/// The file's bytes.
///
/// # Errors
/// [`ExportError::Format`] beyond 4 GiB.
pub fn encode(take: &Take) -> Result<Vec<u8>, ExportError> {
    let mut scene = Scene::default();
    for id in take.ids() {
        let heights = take.people[&id].iter().map(|s| f64::from(s.body.height));
        let height = heights.fold(0.0, f64::max).clamp(0.5, 2.5);
        scene.add(&Motion::of(take, id), height);
    }
    scene.finish()
}

/// A file while it is made.
#[derive(Default)]
struct Scene {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    skins: Vec<Value>,
    samplers: Vec<Value>,
    channels: Vec<Value>,
    roots: Vec<usize>,
}

impl Scene {
    fn add(&mut self, motion: &Motion, height: f64) {
        let person = self.nodes.len();
        let hips = person + 1;
        self.nodes.push(json!({
            "name": format!("person {}", motion.id),
            "children": [hips],
        }));
        let rest = &motion.rest;
        for (bone, name) in HUMANOID_BONES.into_iter().enumerate() {
            let carried = (0..HUMANOID_BONE_COUNT).filter(|&b| rest.parents[b] == Some(bone));
            let children: Vec<usize> = carried.map(|b| hips + b).collect();
            let mut node = json!({
                "name": name,
                "translation": rest.offsets[bone].as_vec3().to_array(),
            });
            if !children.is_empty() {
                node["children"] = json!(children);
            }
            self.nodes.push(node);
        }
        let skinned = self.skin(motion, height, hips);
        self.roots.extend([person, skinned]);
        self.animate(motion, person);
    }

    /// Adds a skin on the bones from node `hips` on; its node.
    fn skin(&mut self, motion: &Motion, height: f64, hips: usize) -> usize {
        let skin = Mannequin::new(&motion.rest, height);
        let mut bind = Vec::new();
        for start in starts(&motion.rest) {
            let s = (-start).as_vec3();
            #[rustfmt::skip]
            bind.extend([
                1.0, 0.0, 0.0, 0.0,
                0.0, 1.0, 0.0, 0.0,
                0.0, 0.0, 1.0, 0.0,
                s.x, s.y, s.z, 1.0,
            ]);
        }
        let bind = self.floats("MAT4", 16, &bind, None, false);
        let position = self.floats(
            "VEC3",
            3,
            skin.positions.as_flattened(),
            Some(ARRAY_BUFFER),
            true,
        );
        let normal = self.floats(
            "VEC3",
            3,
            skin.normals.as_flattened(),
            Some(ARRAY_BUFFER),
            false,
        );
        let weights = self.floats(
            "VEC4",
            4,
            skin.weights.as_flattened(),
            Some(ARRAY_BUFFER),
            false,
        );
        let vertices = skin.bones.len();
        let bones = skin.bones.as_flattened();
        let joints = self.accessor("VEC4", U8, vertices, bones, Some(ARRAY_BUFFER), json!({}));
        let corners: Vec<u8> = skin
            .triangles
            .iter()
            .flat_map(|c| c.to_le_bytes())
            .collect();
        let count = skin.triangles.len();
        let indices = self.accessor(
            "SCALAR",
            U16,
            count,
            &corners,
            Some(ELEMENT_BUFFER),
            json!({}),
        );
        self.materials.push(json!({
            "name": format!("person {}", motion.id),
            "pbrMetallicRoughness": {
                "baseColorFactor": colour(motion.id),
                "metallicFactor": 0.0,
                "roughnessFactor": 0.8,
            },
        }));
        self.meshes.push(json!({
            "name": format!("mannequin {}", motion.id),
            "primitives": [{
                "attributes": {
                    "POSITION": position, "NORMAL": normal, "JOINTS_0": joints, "WEIGHTS_0": weights,
                },
                "indices": indices,
                "material": self.materials.len() - 1,
            }],
        }));
        let bones: Vec<usize> = (hips..hips + HUMANOID_BONE_COUNT).collect();
        self.skins.push(json!({
            "inverseBindMatrices": bind, "joints": bones, "skeleton": hips,
        }));
        self.nodes.push(json!({
            "name": format!("mannequin {}", motion.id),
            "mesh": self.meshes.len() - 1,
            "skin": self.skins.len() - 1,
        }));
        self.nodes.len() - 1
    }

    fn animate(&mut self, motion: &Motion, person: usize) {
        let time = |step: usize| (motion.start + step as f64 / motion.rate) as f32;
        let times: Vec<f32> = (0..motion.moments.len()).map(time).collect();
        let times = self.floats("SCALAR", 1, &times, None, true);
        let places: Vec<f32> = motion
            .moments
            .iter()
            .flat_map(|m| m.position.as_vec3().to_array())
            .collect();
        let places = self.floats("VEC3", 3, &places, None, false);
        self.channel(times, places, "LINEAR", person + 1, "translation");
        for bone in 0..HUMANOID_BONE_COUNT {
            let mut before = glam::Quat::IDENTITY;
            let turns = motion.moments.iter().flat_map(|m| {
                let q = m.rotations[bone].as_quat().normalize();
                // The nearer of the two signs: between two steps numbers are blended.
                before = if q.dot(before) < 0.0 { -q } else { q };
                before.to_array()
            });
            let turns: Vec<f32> = turns.collect();
            let turns = self.floats("VEC4", 4, &turns, None, false);
            self.channel(times, turns, "LINEAR", person + 1 + bone, "rotation");
        }
        self.presence(motion, person);
    }

    /// Size 1 while somebody is there, 0 while not.
    fn presence(&mut self, motion: &Motion, person: usize) {
        let time = |step: usize| (motion.start + step as f64 / motion.rate) as f32;
        let mut changes: Vec<(f32, f32)> = Vec::new();
        if motion.start > 0.0 {
            changes.push((0.0, 0.0));
        }
        for (step, moment) in motion.moments.iter().enumerate() {
            let size = f32::from(u8::from(moment.is_there));
            if changes.last().is_none_or(|(_, s)| *s != size) {
                changes.push((time(step), size));
            }
        }
        changes.push((time(motion.moments.len()), 0.0));
        let times: Vec<f32> = changes.iter().map(|(t, _)| *t).collect();
        let sizes: Vec<f32> = changes.iter().flat_map(|(_, s)| [*s; 3]).collect();
        let times = self.floats("SCALAR", 1, &times, None, true);
        let sizes = self.floats("VEC3", 3, &sizes, None, false);
        self.channel(times, sizes, "STEP", person, "scale");
    }

    fn channel(&mut self, input: usize, output: usize, way: &str, node: usize, path: &str) {
        self.samplers
            .push(json!({ "input": input, "output": output, "interpolation": way }));
        self.channels.push(json!({
            "sampler": self.samplers.len() - 1,
            "target": { "node": node, "path": path },
        }));
    }

    /// Adds numbers, `width` an element, with their bounds where the format wants them.
    fn floats(
        &mut self,
        kind: &str,
        width: usize,
        numbers: &[f32],
        target: Option<u32>,
        bounds: bool,
    ) -> usize {
        let of = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            let column = |c: usize| numbers.iter().skip(c).step_by(width).copied();
            let all = (0..width).map(|c| column(c).reduce(pick).unwrap_or_default());
            all.collect()
        };
        let more = match bounds {
            true => json!({ "min": of(f32::min), "max": of(f32::max) }),
            false => json!({}),
        };
        let bytes: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
        self.accessor(kind, FLOAT, numbers.len() / width, &bytes, target, more)
    }

    fn accessor(
        &mut self,
        kind: &str,
        component: u32,
        count: usize,
        bytes: &[u8],
        target: Option<u32>,
        mut more: Value,
    ) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({
            "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len(),
        });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend(bytes);
        self.views.push(view);
        more["bufferView"] = json!(self.views.len() - 1);
        more["componentType"] = json!(component);
        more["count"] = json!(count);
        more["type"] = json!(kind);
        self.accessors.push(more);
        self.accessors.len() - 1
    }

    fn finish(mut self) -> Result<Vec<u8>, ExportError> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let text = json!({
            "asset": { "version": "2.0", "generator": format!("edgecap {}", env!("CARGO_PKG_VERSION")) },
            "scene": 0,
            "scenes": [{ "nodes": self.roots }],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "skins": self.skins,
            "animations": [{
                "name": "take", "samplers": self.samplers, "channels": self.channels,
            }],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.bytes.len() }],
        });
        let mut text = text.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let size = |n: usize| {
            let too_large = |_| ExportError::Format("more than 4 GiB".to_owned());
            u32::try_from(n).map(u32::to_le_bytes).map_err(too_large)
        };
        let mut file = Vec::with_capacity(28 + text.len() + self.bytes.len());
        file.extend(b"glTF");
        file.extend(2u32.to_le_bytes());
        file.extend(size(28 + text.len() + self.bytes.len())?);
        file.extend(size(text.len())?);
        file.extend(b"JSON");
        file.extend(text);
        file.extend(size(self.bytes.len())?);
        file.extend(b"BIN\0");
        file.extend(self.bytes);
        Ok(file)
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
