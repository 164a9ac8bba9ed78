//! What the viewer of a report shows: JSON with base64 buffers.

use serde::Serialize;

/// A mesh as the viewer reads it: little-endian numbers in base64, one after the other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scene {
    /// The middle of what is shown.
    pub center: [f32; 3],
    /// Half the diagonal of what is shown; above 0.
    pub radius: f32,
    /// Three `f32` a vertex.
    pub positions: String,
    /// Three `f32` a vertex, of length 1.
    pub normals: String,
    /// Three `u32` a face.
    pub faces: String,
    /// Three bytes of sRGB a vertex.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colors: Option<String>,
    /// Two `f32` a vertex.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uvs: Option<String>,
    /// A PNG as a `data:` address.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texture: Option<String>,
}

/// Nothing, in a box of side 1.
impl Default for Scene {
    fn default() -> Self {
        Self {
            center: [0.5; 3],
            radius: 0.75_f32.sqrt(),
            positions: String::new(),
            normals: String::new(),
            faces: String::new(),
            colors: None,
            uvs: None,
            texture: None,
        }
    }
}

impl Scene {
    /// The JSON text. `<` is escaped, so that it is safe inside a `<script>` element whatever the
    /// buffers hold.
    pub(super) fn to_json(&self) -> String {
        let text = serde_json::to_string(self).expect("strings and finite numbers serialise");
        text.replace('<', "\\u003c")
    }
}
