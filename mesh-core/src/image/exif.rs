//! The one thing of EXIF that changes what an image shows.

/// How a camera was held, as EXIF counts: where in the scene the stored row 0 and column 0 are.
///
/// # References
/// CIPA DC-008 (EXIF 2.32), tag 0x0112.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Orientation {
    #[default]
    TopLeft = 1,
    TopRight,
    BottomRight,
    BottomLeft,
    LeftTop,
    RightTop,
    RightBottom,
    LeftBottom,
}

impl Orientation {
    /// By the number of the tag.
    pub(super) const ALL: [Self; 8] = [
        Self::TopLeft,
        Self::TopRight,
        Self::BottomRight,
        Self::BottomLeft,
        Self::LeftTop,
        Self::RightTop,
        Self::RightBottom,
        Self::LeftBottom,
    ];

    /// Whether rows of the file are columns of the scene.
    pub(super) fn is_lying(self) -> bool {
        matches!(self, Self::LeftTop | Self::RightTop | Self::RightBottom | Self::LeftBottom)
    }

    /// That of an EXIF block, with or without its first six bytes; `None` where it says nothing that can be read.
    pub(super) fn of(exif: &[u8]) -> Option<Self> {
        /// The tag, and its type: one unsigned number of 16 bits.
        const TAG: u16 = 0x0112;
        const SHORT: u16 = 3;
        let tiff = exif.strip_prefix(b"Exif\0\0").unwrap_or(exif);
        let little = match tiff.get(..4)? {
            b"II*\0" => true,
            b"MM\0*" => false,
            _ => return None,
        };
        let short = |at: usize| {
            let bytes = tiff.get(at..at.checked_add(2)?)?.try_into().ok()?;
            Some(if little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
        };
        let long = |at: usize| {
            let bytes = tiff.get(at..at.checked_add(4)?)?.try_into().ok()?;
            Some(if little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
        };
        let directory = long(4)? as usize;
        let entries = usize::from(short(directory)?);
        // Each is tag, type, count and value, in 12 bytes.
        let first = directory + 2;
        let entry = (0..entries).map(|k| first + 12 * k).find(|&at| short(at) == Some(TAG))?;
        if (short(entry + 2)?, long(entry + 4)?) != (SHORT, 1) {
            return None;
        }
        Self::ALL.get(usize::from(short(entry + 8)?).checked_sub(1)?).copied()
    }
}
