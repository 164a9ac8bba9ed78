//! Depth in OpenEXR files.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Layer, LayerAttributes,
    ReadChannels, ReadLayers, Text, Vec2, WritableImage, read,
};

use super::error::{too_large, too_many, undecodable};
use super::file::read_bytes;
use super::{DepthMap, Image, ImageError, depth};
use crate::Limits;
use crate::io::{WriteError, write_atomic};

/// No compression of OpenEXR's unpacks to more than this many times its size.
const RATIO: u64 = 2000;

/// Reads planar depth from an EXR file.
///
/// The channel is the first of `Z`, `V`, one of those under a name with "depth" in it
/// (`depth.V`, `View Layer.Depth.Z`), or `R`, where `G` and `B`, if there are any, hold the same. Values of 1e9 and more, or not
/// finite, are holes.
///
/// # Errors
/// The file cannot be read, is no EXR, is damaged, claims what cannot be or what the default
/// [`Limits`] do not allow, or holds no depth; if it is a picture in colour.
pub fn read_depth(path: impl AsRef<Path>) -> Result<DepthMap, ImageError> {
    let path = path.as_ref();
    decode_depth(&read_bytes(path)?, path)
}

/// The same for bytes that are already in memory; `name` stands for them in errors.
///
/// # Errors
/// As [`read_depth`].
pub fn decode_depth(bytes: &[u8], name: impl AsRef<Path>) -> Result<DepthMap, ImageError> {
    decode_depth_with(bytes, name, &Limits::default())
}

/// [`decode_depth`] within other limits; they count the samples of all channels.
///
/// # Errors
/// As [`read_depth`].
pub fn decode_depth_with(
    bytes: &[u8],
    name: impl AsRef<Path>,
    limits: &Limits,
) -> Result<DepthMap, ImageError> {
    let path = name.as_ref();
    check_claims(bytes, path, limits)?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(undecodable(path))?;

    let channels: Vec<(String, &Layer<AnyChannels<FlatSamples>>, &FlatSamples)> = image
        .layer_data
        .iter()
        .flat_map(|layer| {
            layer.channel_data.list.iter().map(move |channel| {
                let name = match &layer.attributes.layer_name {
                    Some(layer) if !layer.as_slice().is_empty() => {
                        format!("{layer}.{}", channel.name)
                    }
                    _ => channel.name.to_string(),
                };
                (name, layer, &channel.sample_data)
            })
        })
        .collect();
    let names: Vec<&str> = channels.iter().map(|(name, ..)| name.as_str()).collect();
    let chosen = choose(&names).ok_or_else(|| ImageError::NoDepth {
        path: path.to_owned(),
        found: if names.is_empty() { "none".to_owned() } else { names.join(", ") },
    })?;
    let (name, layer, samples) = &channels[chosen];
    // By their bits: holes may be no numbers, which equal nothing.
    let bits =
        |samples: &FlatSamples| -> Vec<u32> { samples.values_as_f32().map(f32::to_bits).collect() };
    let same = |other: &FlatSamples| bits(other) == bits(samples);
    let of_colors = |(name, ..): &&(String, _, _)| ["G", "B"].contains(&name.as_str());
    if name == "R" && channels.iter().filter(of_colors).any(|(.., other)| !same(other)) {
        return Err(ImageError::Colored { path: path.to_owned() });
    }

    // A layer may cover a part of the image, or more than it.
    let window = image.attributes.display_window;
    let (width, height) = (window.size.width(), window.size.height());
    check((width, height), (width as u64).saturating_mul(height as u64), bytes, path, limits)?;
    let mut data = vec![f32::INFINITY; width * height];
    let offset = layer.attributes.layer_position - window.position;
    for (k, value) in samples.values_as_f32().enumerate() {
        let column = (k % layer.size.width()) as i64 + offset.x() as i64;
        let row = (k / layer.size.width()) as i64 + offset.y() as i64;
        if (0..width as i64).contains(&column) && (0..height as i64).contains(&row) {
            data[row as usize * width + column as usize] = depth::from_file(value);
        }
    }
    Ok(DepthMap { height, width, data })
}

/// Writes planar depth to an EXR file: one channel `Z` of 32-bit floats, 1e10 for holes.
///
/// # Errors
/// The file cannot be written.
///
/// # Panics
/// As [`encode_depth`].
pub fn write_depth(path: impl AsRef<Path>, map: &DepthMap) -> Result<(), WriteError> {
    let bytes = encode_depth(map);
    write_atomic(path, |w| w.write_all(&bytes))
}

/// An EXR file in memory: one channel `Z` of 32-bit floats, 1e10 for holes.
///
/// # Panics
/// If the map is empty or its data is of another length.
pub fn encode_depth(map: &DepthMap) -> Vec<u8> {
    let DepthMap { height, width, ref data } = *map;
    assert!(
        height * width > 0 && data.len() == height * width,
        "encode_depth: {width} x {height} pixels in {} floats",
        data.len()
    );
    let samples = data.iter().map(|&v| depth::to_file(v)).collect();
    encode(width, height, vec![("Z", samples)])
}

/// An EXR file in memory of floats as they are: channel `V` of an image with one channel, `R`, `G`,
/// `B` of one with three. [`decode_depth`] reads back those of one channel.
///
/// # Panics
/// If the image is empty, has another number of channels, or its data is of another length.
pub fn encode_exr(image: &Image) -> Vec<u8> {
    let Image { height, width, channels, ref data } = *image;
    assert!(
        height * width > 0 && data.len() == height * width * channels,
        "encode_exr: {width} x {height} pixels of {channels} channels in {} floats",
        data.len()
    );
    let names: &[&str] = match channels {
        1 => &["V"],
        3 => &["R", "G", "B"],
        n => panic!("encode_exr: {n} channels, expected 1 or 3"),
    };
    let plane = |k: usize| data.iter().skip(k).step_by(channels).copied().collect();
    encode(width, height, names.iter().enumerate().map(|(k, name)| (*name, plane(k))).collect())
}

fn encode(width: usize, height: usize, channels: Vec<(&str, Vec<f32>)>) -> Vec<u8> {
    let channels = channels
        .into_iter()
        .map(|(name, samples)| AnyChannel::new(Text::from(name), FlatSamples::F32(samples)));
    let encoding = Encoding { compression: Compression::ZIP16, ..Encoding::default() };
    let layer = Layer::new(
        (width, height),
        LayerAttributes::default(),
        encoding,
        AnyChannels::sort(channels.collect()),
    );
    let mut bytes = Cursor::new(Vec::new());
    exr::prelude::Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .expect("a checked image into memory");
    bytes.into_inner()
}

/// Which of the channels is depth.
fn choose(names: &[&str]) -> Option<usize> {
    let last = |name: &str| name.rsplit('.').next().unwrap_or(name).to_owned();
    let rank = |name: &str| {
        let depth = name.to_lowercase().contains("depth");
        match (name, last(name).as_str()) {
            ("Z", _) => Some(0),
            ("V", _) => Some(1),
            (_, "Z" | "V" | "R" | "Y") if depth => Some(2),
            ("R", _) => Some(4),
            // A layer's Z without X is its depth; with X it is a vector.
            (_, "Z") => {
                let x = format!("{}X", &name[..name.len() - 1]);
                (!names.contains(&x.as_str())).then_some(3)
            }
            _ => None,
        }
    };
    (0..names.len()).filter_map(|i| Some((rank(names[i])?, i))).min().map(|(_, i)| i)
}

/// Refuses headers that claim more than the file can hold, before anything is allocated.
fn check_claims(bytes: &[u8], path: &Path, limits: &Limits) -> Result<(), ImageError> {
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false)
        .map_err(undecodable(path))?;
    let mut total = 0_u64;
    for header in &meta.headers {
        let Vec2(width, height) = header.layer_size;
        let pixels = (width as u64).saturating_mul(height as u64);
        let depth = header.channels.bytes_per_pixel as u64;
        total = total.saturating_add(pixels.saturating_mul(depth));
        check((width, height), total, bytes, path, limits)?;
        // A tile may be larger than its image, and its bytes are made room for before they are there.
        if let exr::meta::BlockDescription::Tiles(tiles) = header.blocks {
            let Vec2(width, height) = tiles.tile_size;
            let tile = (width as u64).saturating_mul(height as u64).saturating_mul(depth);
            too_many(path, (width, height), tile, limits)?;
        }
    }
    Ok(())
}

fn check(
    size: (usize, usize),
    claimed: u64,
    bytes: &[u8],
    path: &Path,
    limits: &Limits,
) -> Result<(), ImageError> {
    let possible = (bytes.len() as u64).saturating_mul(RATIO);
    too_large(path, size, claimed, possible, bytes.len())?;
    too_many(path, size, claimed, limits)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use exr::prelude::Blocks;
    use proptest::prelude::*;

    use super::*;

    fn map() -> DepthMap {
        let data = vec![1.0, 2.5, f32::INFINITY, 4.25, 1e-3, 208.125];
        DepthMap { height: 2, width: 3, data }
    }

    /// A file as other tools write it: a display window, a layer inside it, channels by name.
    fn foreign(layer: Option<&str>, channels: &[(&str, f32)]) -> Vec<u8> {
        let list = channels
            .iter()
            .map(|&(name, v)| AnyChannel::new(Text::from(name), FlatSamples::F32(vec![v; 2])))
            .collect();
        let attributes = LayerAttributes {
            layer_name: layer.map(Text::from),
            layer_position: Vec2(1, 1),
            ..LayerAttributes::default()
        };
        let layer = Layer::new((2, 1), attributes, Encoding::default(), AnyChannels::sort(list));
        let mut image = exr::prelude::Image::from_layer(layer);
        image.attributes.display_window = exr::prelude::IntegerBounds::from_dimensions((3, 2));
        let mut bytes = Cursor::new(Vec::new());
        image.write().non_parallel().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    /// Room for a whole tile is made before its bytes are read.
    #[test]
    fn tiles_are_held_to_the_limits() {
        let list = vec![AnyChannel::new(Text::from("Z"), FlatSamples::F32(vec![1.0; 4]))];
        let encoding = Encoding { blocks: Blocks::Tiles(Vec2(4, 4)), ..Encoding::UNCOMPRESSED };
        let channels = AnyChannels::sort(list.into_iter().collect());
        let layer = Layer::new((2, 2), LayerAttributes::default(), encoding, channels);
        let mut bytes = Cursor::new(Vec::new());
        let image = exr::prelude::Image::from_layer(layer);
        image.write().non_parallel().to_buffered(&mut bytes).unwrap();
        let mut bytes = bytes.into_inner();
        assert_eq!(decode_depth(&bytes, "tiles.exr").unwrap().data, [1.0; 4]);

        // Behind the attribute's name, its type and its length.
        let name = b"tiledesc\0";
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
        bytes[at + 4..at + 8].copy_from_slice(&0x2000_0040_u32.to_le_bytes());
        let error = decode_depth(&bytes, "tiles.exr").unwrap_err();
        assert!(matches!(error, ImageError::OverLimit { .. }), "{error}");
    }

    #[test]
    fn a_map_comes_back_with_its_holes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.exr");
        write_depth(&path, &map()).unwrap();
        assert_eq!(read_depth(&path).unwrap(), map());
        let raw = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(&path)
            .unwrap();
        let channel = &raw.layer_data.channel_data.list[0];
        assert_eq!(channel.name.to_string(), "Z");
        assert_eq!(channel.sample_data.value_by_flat_index(2).to_f32(), 1e10);
    }

    #[test]
    fn floats_come_back_as_they_are() {
        let data = vec![-1.5, 0.0, 1e-7, 3.25, 0.5, -0.25];
        let image = Image { height: 3, width: 2, channels: 1, data };
        assert_eq!(decode_depth(&encode_exr(&image), "a.exr").unwrap().data, image.data);
        let colors = Image { height: 1, width: 2, channels: 3, data: image.data.clone() };
        let error = decode_depth(&encode_exr(&colors), "a.exr").unwrap_err();
        assert!(matches!(error, ImageError::Colored { .. }), "{error}");
        let gray = Image { data: vec![-1.5, -1.5, -1.5, 3.25, 3.25, 3.25], ..colors };
        assert_eq!(decode_depth(&encode_exr(&gray), "a.exr").unwrap().data, [-1.5, 3.25]);
        let hole = Image { data: vec![f32::NAN; 6], ..gray };
        let depth = decode_depth(&encode_exr(&hole), "a.exr").unwrap();
        assert!(depth.data.iter().all(|z| !z.is_finite()));
    }

    #[test]
    fn channels_are_found_as_people_name_them() {
        let depth = |layer, channels: &[(&str, f32)]| {
            decode_depth(&foreign(layer, channels), "a.exr").map(|m| m.data[4])
        };
        assert_eq!(depth(None, &[("B", 1.0), ("G", 2.0), ("R", 3.0), ("Z", 4.0)]).unwrap(), 4.0);
        assert_eq!(depth(None, &[("B", 3.0), ("G", 3.0), ("R", 3.0)]).unwrap(), 3.0);
        assert!(depth(None, &[("B", 1.0), ("G", 2.0), ("R", 3.0)]).is_err());
        assert_eq!(depth(Some("depth"), &[("V", 5.0)]).unwrap(), 5.0);
        let blender = [("View Layer.Combined.R", 1.0), ("View Layer.Depth.Z", 6.0)];
        assert_eq!(depth(None, &blender).unwrap(), 6.0);
        let normals = [("N.X", 1.0), ("N.Y", 1.0), ("N.Z", 1.0)];
        let error = depth(None, &normals).unwrap_err().to_string();
        assert!(error.contains("N.X") && error.contains("a.exr"), "{error}");
    }

    #[test]
    fn a_layer_lies_where_it_says() {
        let map = decode_depth(&foreign(None, &[("Z", 2.0)]), "a.exr").unwrap();
        let inf = f32::INFINITY;
        assert_eq!(map, DepthMap { height: 2, width: 3, data: vec![inf, inf, inf, inf, 2.0, 2.0] });
        for hole in [1e9, 65504.0, f32::NAN, f32::INFINITY] {
            let map = decode_depth(&foreign(None, &[("Z", hole)]), "a.exr").unwrap();
            assert_eq!(map.data[4], inf);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(512))]
        #[test]
        fn damaged_files_are_errors_or_maps(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            cut in prop::option::of(any::<prop::sample::Index>()),
        ) {
            let mut bytes = encode_depth(&map());
            for (at, value) in changes {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            let _ = decode_depth(&bytes, "fuzz.exr");
        }
    }

    #[test]
    fn z_goes_before_all_others() {
        assert_eq!(choose(&["A", "V", "Z"]), Some(2));
        assert_eq!(choose(&["R", "V"]), Some(1));
        assert_eq!(choose(&["R", "depth.V"]), Some(1));
    }
}
