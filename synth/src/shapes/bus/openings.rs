//! Doors and windows of a bus.

use super::super::assembly::Assembly;
use super::super::draw::Draw;
use super::plan::{Bus, GLASS, Stretch, Style, TRIM};

/// Middles of the doors, front to rear.
pub(super) fn doors(bus: &Bus) -> Vec<f64> {
    let first = match bus.style {
        Style::School => bus.front - bus.bonnet[0] - 0.75,
        Style::Minibus => bus.axles[1] - 1.15,
        _ => bus.front - 1.0,
    };
    match bus.style {
        Style::City => vec![first, 0.5 * (bus.axles[0] + bus.axles[1]) + 0.2],
        Style::Articulated => {
            vec![first, 0.5 * (bus.axles[1] + bus.axles[2]) + 0.2, bus.axles[0] + 2.0]
        }
        Style::DoubleDecker => vec![first, bus.axles[1] - 2.4],
        _ => vec![first],
    }
}

/// Adds one door, with its two panes, on the side of the curb.
pub(super) fn door(all: &mut Assembly, bus: &Bus, z: f64, curb: f64) {
    let half = if matches!(bus.style, Style::Coach | Style::School | Style::Minibus) {
        0.45
    } else {
        0.62
    };
    let top = (bus.decks[0][1] + 0.04).min(2.75);
    let low = bus.ground + 0.1;
    bus.on_side(all, "door", ([z - half, z + half], [low, top]), (0.05, 0.03), TRIM, Some(curb));
    for k in [-1.0, 1.0] {
        let pane = [z + 0.5 * k * half - 0.4 * half, z + 0.5 * k * half + 0.4 * half];
        let y = [low + 0.12, top - 0.1];
        bus.on_side(all, "door pane", (pane, y), (0.04, 0.045), [0.35, 0.42, 0.47], Some(curb));
    }
}

/// Adds the side windows; returns how many there are on a side of the lowest deck.
pub(super) fn windows(
    all: &mut Assembly,
    bus: &Bus,
    draw: &mut Draw,
    stretches: &[Stretch],
    (doors, curb, glazing): (&[f64], f64, &str),
) -> usize {
    let pitch = match bus.style {
        Style::School => draw.within(0.72, 0.9),
        Style::Minibus => draw.within(1.0, 1.3),
        _ => draw.within(1.1, 1.75),
    };
    let mut panes = 0;
    for (deck, &heights) in bus.decks.iter().enumerate() {
        for stretch in stretches {
            let r = stretch.rear + bus.round + 0.15;
            let f = if stretch.ends[1] {
                bus.face(heights[1]) - bus.round - 0.08
            } else {
                stretch.front - bus.round - 0.05
            };
            let count = ((f - r) / pitch).round().max(2.0) as usize;
            let step = (f - r) / count as f64;
            panes += if deck == 0 { count } else { 0 };
            let gap = if glazing == "ribbon" { 0.02 } else { 0.07 };
            if glazing == "ribbon" {
                bus.on_side(all, "glass", ([r, f], heights), (0.08, 0.02), GLASS, None);
            }
            for k in 0..count {
                let z = [r + step * k as f64 + gap, r + step * (k as f64 + 1.0) - gap];
                if glazing == "ribbon" {
                    if k > 0 {
                        let post = [z[0] - gap - 0.02, z[0] - gap + 0.02];
                        let shade = [0.24, 0.28, 0.31];
                        bus.on_side(all, "post", (post, heights), (0.005, 0.03), shade, None);
                    }
                    continue;
                }
                let near = |&door: &f64| z[0] < door + 0.6 && z[1] > door - 0.6;
                for side in [-1.0, 1.0] {
                    // The lower deck has no windows where doors are.
                    if deck > 0 || side != curb || !doors.iter().any(&near) {
                        let place = (z, heights);
                        bus.on_side(all, "window", place, (0.09, 0.025), GLASS, Some(side));
                    }
                }
            }
        }
    }
    panes
}
