//! How a bus is painted.

use super::super::assembly::Assembly;
use super::super::draw::Draw;
use super::super::solid;
use super::plan::{Bus, Stretch, Style, TRIM, WHITE};

/// What the bus is painted with.
pub(super) struct Colors {
    pub(super) base: [f32; 3],
    pub(super) second: [f32; 3],
    pub(super) livery: &'static str,
}

impl Colors {
    pub(super) fn draw(draw: &mut Draw, style: Style) -> Self {
        if style == Style::School {
            return Self { base: [0.96, 0.70, 0.06], second: TRIM, livery: "school" };
        }
        let livery = draw.pick(&["plain", "skirt", "band", "diagonal", "roof"]);
        let strong = match style {
            Style::DoubleDecker if draw.chance(0.5) => [0.78, 0.07, 0.09],
            _ => draw.color([0.65, 0.92], [0.45, 0.85]),
        };
        let light = draw.pick(&[WHITE, [0.85, 0.86, 0.87], [0.96, 0.92, 0.8]]);
        let (base, second) =
            if livery == "plain" || draw.chance(0.4) { (strong, light) } else { (light, strong) };
        Self { base, second, livery }
    }
}

pub(super) fn livery(all: &mut Assembly, bus: &Bus, colors: &Colors, stretches: &[Stretch]) {
    for stretch in stretches {
        // Where sides are flat: clear of round corners.
        let [r, f] = [stretch.rear + bus.round + 0.01, stretch.front - bus.round - 0.03];
        let f = if stretch.ends[1] { f - bus.bonnet[0] } else { f };
        let belt = bus.decks[0][0] - 0.12;
        let band = |all: &mut Assembly, y: [f64; 2]| {
            bus.on_side(all, "livery", ([r, f], y), (0.02, 0.012), colors.second, None);
        };
        match colors.livery {
            "band" => {
                band(all, [belt - 0.2, belt]);
                band(all, [bus.decks[0][1] + 0.06, bus.decks[0][1] + 0.18]);
            }
            "school" => {
                for y in [bus.decks[0][0] - 0.15, bus.decks[0][0] - 0.5] {
                    band(all, [y - 0.07, y]);
                }
            }
            "skirt" => all.pair("livery", bus.skirt([r, f], [belt, belt]), colors.second),
            "diagonal" => {
                let top = bus.height - bus.round - 0.02;
                let end = r + 0.42 * (f - r);
                all.pair("livery", bus.skirt([r, end], [top, top]), colors.second);
                let (low, lean) = (bus.ground + 0.02, 0.55 * (top - belt));
                let wedge =
                    [[end - 0.02, low], [end + 0.02, low], [end + lean, top], [end - 0.02, top]];
                let (a, b) = (end + 0.4, end + 0.75);
                let stripe = [[a, low], [b, low], [b + lean, top], [a + lean, top]];
                for outline in [wedge, stripe] {
                    let clear = bus.axles.iter().all(|&z| {
                        let reach = 1.25 * bus.wheel;
                        z + reach < outline[0][0] || z - reach > outline[2][0]
                    });
                    if clear {
                        let sheet =
                            solid::side_prism(&outline, [bus.half - 0.05, bus.half + 0.011]);
                        all.pair("livery", sheet, colors.second);
                    }
                }
            }
            "roof" => {
                let at = [0.0, bus.height - 0.02, 0.5 * (r + f) - 0.5 * bus.lean];
                let size = [2.0 * (bus.half - bus.round) + 0.1, 0.1, f - r - bus.lean - 0.3];
                all.add("roof", solid::rounded_block(at, size, 0.04), colors.second);
                band(all, [belt - 0.35, belt]);
            }
            _ => {}
        }
    }
}
