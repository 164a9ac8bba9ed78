//! Files that several tests make.

/// A GLB of the given JSON and binary chunk.
pub(crate) fn glb_of(json: &str, bin: &[u8]) -> Vec<u8> {
    // A width in a format may be at most 65,535.
    let json = format!("{json}{}", " ".repeat(json.len().next_multiple_of(4) - json.len()));
    let mut bytes = Vec::new();
    let total = 28 + json.len() + bin.len();
    for word in [0x4654_6c67, 2, total as u32, json.len() as u32, 0x4e4f_534a] {
        bytes.extend(u32::to_le_bytes(word));
    }
    bytes.extend(json.as_bytes());
    bytes.extend((bin.len() as u32).to_le_bytes());
    bytes.extend(0x004e_4942_u32.to_le_bytes());
    bytes.extend(bin);
    bytes
}
