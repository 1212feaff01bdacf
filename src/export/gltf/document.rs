//! A glTF file while it is made: numbers go in as accessors, nodes refer to them, bytes come out.

use serde_json::{Value, json};

use crate::export::error::ExportError;

const FLOAT: u32 = 5126;
/// Component type: 16 bits, unsigned.
pub const U16: u32 = 5123;
/// Component type: 32 bits, unsigned.
pub const U32: u32 = 5125;
/// Component type: 8 bits, unsigned.
pub const U8: u32 = 5121;
/// What vertices are read from.
pub const ARRAY_BUFFER: u32 = 34962;
/// What triangles are read from.
pub const ELEMENT_BUFFER: u32 = 34963;

/// A file while it is made.
#[derive(Default)]
pub struct Document {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    /// Nodes; others refer to them by place.
    pub nodes: Vec<Value>,
    /// Meshes.
    pub meshes: Vec<Value>,
    /// Materials.
    pub materials: Vec<Value>,
    /// Skins.
    pub skins: Vec<Value>,
    samplers: Vec<Value>,
    channels: Vec<Value>,
    /// Nodes that hang on none.
    pub roots: Vec<usize>,
}

impl Document {
    /// Adds a way in which `path` of a node changes: keys and values are accessors.
    pub fn channel(&mut self, input: usize, output: usize, way: &str, node: usize, path: &str) {
        self.samplers
            .push(json!({ "input": input, "output": output, "interpolation": way }));
        self.channels.push(json!({
            "sampler": self.samplers.len() - 1,
            "target": { "node": node, "path": path },
        }));
    }

    /// Adds numbers, `width` an element, with their bounds where the format wants them.
    pub fn floats(
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

    /// Adds little-endian numbers of any kind.
    pub fn accessor(
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

    /// The file's bytes.
    ///
    /// # Errors
    /// [`ExportError::Format`] beyond 4 GiB.
    pub fn finish(mut self) -> Result<Vec<u8>, ExportError> {
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
