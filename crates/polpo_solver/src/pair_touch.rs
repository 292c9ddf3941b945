//! Whether and how two particles touch in a substep.

use glam::Vec3A;

use crate::Sides;
use crate::ellipsoid_pair::{EllipsoidPair, thickness};
use crate::pairs::{Pair, nearest};

/// An overlap.
pub(crate) struct Touch {
    /// From the first to the second.
    pub(crate) normal: Vec3A,
    /// Negative \[m\].
    pub(crate) gap: f32,
    /// What it was when the substep began \[m\].
    pub(crate) before: f32,
    /// Where they touch, from the first's centre \[m\].
    pub(crate) point: Vec3A,
}

/// Whether the two overlap, and how. Keeps the pair's normal up to date.
pub(crate) fn look(pair: &mut Pair, sides: &Sides, way_out: Option<Vec3A>) -> Option<Touch> {
    let [i, j] = pair.particles.map(|i| i as usize);
    let ([xa, xa0], [xb, xb0]) = (sides.places(0, i)?, sides.places(1, j)?);
    let (d, d0) = (xb - xa, xb0 - xa0);
    let way = d - d0;
    let fast = way.length_squared() > (0.5 * pair.thickness).powi(2);
    let closest = if fast { nearest(d0, way) } else { d };
    // Neither is what is not finite.
    let near = closest.length_squared() < pair.reach * pair.reach;
    if !near {
        pair.known = false;
        return None;
    }
    let mut touch = if pair.round { look_at_spheres(pair, sides, d, d0, fast) } else { look_at_ellipsoids(pair, sides, d, d0, fast) }?;
    if let Some(out) = way_out {
        // Which of them overlap is theirs to say; where to, the bodies'.
        let e = [sides.ellipsoid(0, i), sides.ellipsoid(1, j)];
        let along = EllipsoidPair::new(&e[0], &e[1], d).along(out);
        touch = Touch { normal: out, gap: along.gap, before: along.gap + out.dot(d0 - d), point: 0.5 * d };
    }
    Some(touch)
}

fn look_at_spheres(pair: &mut Pair, sides: &Sides, d: Vec3A, d0: Vec3A, fast: bool) -> Option<Touch> {
    let reach = pair.reach;
    let before = d0.length() - reach;
    let mut normal = d.try_normalize().unwrap_or(pair.normal);
    if fast && before >= 0.0 {
        // |d0 + t·way| = reach, the first time.
        let way = d - d0;
        let (a, b) = (way.length_squared(), d0.dot(way));
        let root = b * b - a * (before * (before + 2.0 * reach));
        let t = (-b - root.max(0.0).sqrt()) / a;
        let meet = b < 0.0 && root >= 0.0 && t <= 1.0;
        if !meet {
            return None;
        }
        normal = ((d0 + way * t) / reach).normalize();
    } else if pair.known && normal.dot(pair.normal) < 0.0 {
        normal = pair.normal;
    }
    (pair.normal, pair.known) = (normal, true);
    let gap = normal.dot(d) - reach;
    let overlap = gap < 0.0;
    if !overlap {
        return None;
    }
    let first = sides.side(0).0.radii[pair.particles[0] as usize].x;
    Some(Touch { normal, gap, before, point: normal * (first + 0.5 * gap) })
}

fn look_at_ellipsoids(pair: &mut Pair, sides: &Sides, d: Vec3A, d0: Vec3A, fast: bool) -> Option<Touch> {
    let [i, j] = pair.particles.map(|i| i as usize);
    let e = [sides.ellipsoid(0, i), sides.ellipsoid(1, j)];
    // Most are apart along the normal of a moment ago, which takes no matrices to see.
    if pair.known && !fast && pair.normal.dot(d) >= e.iter().map(|e| thickness(e, pair.normal)).sum() {
        return None;
    }
    let both = EllipsoidPair::new(&e[0], &e[1], d);
    let mut met = None;
    if fast {
        match sweep(pair, &both.at(d0), d - d0) {
            Path::Clear => return None,
            Path::Meets(normal) => met = Some(normal),
            Path::Inside => {}
        }
    }
    let before_is_clear = met.is_some();
    let found = match met {
        Some(normal) => both.along(normal),
        None if pair.known => {
            let found = both.contact_near(pair.normal);
            if found.normal.dot(pair.normal) < 0.0 { both.along(pair.normal) } else { found }
        }
        None => both.contact(),
    };
    let normal_before = core::mem::replace(&mut pair.normal, found.normal);
    if !found.normal.is_finite() {
        (pair.normal, pair.known) = (normal_before, false);
        return None;
    }
    let was_known = core::mem::replace(&mut pair.known, true);
    let overlap = found.gap < 0.0;
    if !overlap {
        return None;
    }
    let before = if before_is_clear {
        0.0
    } else {
        let e = [sides.ellipsoid_before(0, i), sides.ellipsoid_before(1, j)];
        let gap = |n: Vec3A| n.dot(d0) - e[0].support(n).0 - e[1].support(n).0;
        let now = gap(found.normal);
        // Each direction's gap is a bound from below.
        if now < 0.0 && was_known { now.max(gap(normal_before)) } else { now }
    };
    Some(Touch { normal: found.normal, gap: found.gap, before, point: 0.5 * (found.reach[0] + found.reach[1] + d) })
}

/// What two ellipsoids meet with on the way of one past the other.
enum Path {
    /// Nothing.
    Clear,
    /// They overlap at its start.
    Inside,
    /// They meet, with this normal.
    Meets(Vec3A),
}

/// Conservative advancement: the gap along a normal is a bound for the gap all along the way, so going on until that bound is zero never goes too far. The distance is convex along a line, which makes
/// this Newton's method from one side.
fn sweep(pair: &Pair, start: &EllipsoidPair, way: Vec3A) -> Path {
    let mut found = if pair.known { start.contact_near(pair.normal) } else { start.contact() };
    if pair.known && found.gap < 0.0 {
        found = start.contact();
    }
    // A thousandth of an overlap is where the last substep left them.
    let apart = found.gap > -1e-3 * pair.thickness;
    if !apart {
        return Path::Inside;
    }
    let mut t = 0.0;
    for _ in 0..16 {
        let closing = -found.normal.dot(way);
        let meet = closing > 0.0;
        if !meet {
            return Path::Clear;
        }
        t += found.gap.max(0.0) / closing;
        if t >= 1.0 {
            return Path::Clear;
        }
        if found.gap < 1e-3 * pair.thickness {
            break;
        }
        found = start.moved(way * t).contact_near(found.normal);
    }
    Path::Meets(found.normal)
}
