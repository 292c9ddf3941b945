//! Polygons and strips into triangles. Convex polygons become fans, others are cut by clipping ears.
//!
//! n corners give n − 2 triangles, whose border is the polygon: corners on a straight line stay, so that neighbours still meet in
//! them. A polygon that crosses itself gives as many triangles, of no particular shape.

use glam::{DVec2, DVec3, Vec3};

/// The steps that all polygons of a file together may take, a second or few: a ragged outline of 10,000 corners takes a tenth.
const EFFORT: usize = 200_000_000;
/// Sines of corners that turn inwards by less than this are noise.
const STRAIGHT: f64 = 1e-6;

/// Cuts a file's polygons.
pub(crate) struct Cutter {
    effort: usize,
}

impl Default for Cutter {
    fn default() -> Cutter {
        Cutter { effort: EFFORT }
    }
}

impl Cutter {
    /// Adds the triangles of a polygon, in its own sense of rotation; none if it has fewer than three corners. `corners` and
    /// `positions` go together.
    pub(crate) fn cut(&mut self, corners: &[u32], positions: &[Vec3], triangles: &mut Vec<[u32; 3]>) -> Result<(), String> {
        match flattened(positions) {
            Some(flat) if corners.len() > 3 => self.clip_ears(corners, &flat, triangles),
            _ => {
                fan(corners, triangles);
                Ok(())
            }
        }
    }

    fn clip_ears(&mut self, corners: &[u32], flat: &[DVec2], triangles: &mut Vec<[u32; 3]>) -> Result<(), String> {
        let mut ring: Vec<[usize; 2]> = (0..flat.len()).map(|i| [(i + flat.len() - 1) % flat.len(), (i + 1) % flat.len()]).collect();
        let turn = |ring: &[[usize; 2]], i: usize| area(flat[ring[i][0]], flat[i], flat[ring[i][1]]);
        // Only these can lie in an ear.
        let mut inward: Vec<usize> = (0..flat.len()).filter(|&i| turn(&ring, i) <= 0.0).collect();
        let (mut at, mut left, mut tried) = (0, flat.len(), 0);
        while left > 3 && tried < left {
            self.effort = self
                .effort
                .checked_sub(1 + inward.len())
                .ok_or_else(|| format!("the {} corners of this face and those before are too much to cut", corners.len()))?;
            let [before, after] = ring[at];
            let ear = [flat[before], flat[at], flat[after]];
            if turn(&ring, at) > 0.0 && !inward.iter().any(|&i| within(flat[i], ear) && !ear.contains(&flat[i])) {
                triangles.push([corners[before], corners[at], corners[after]]);
                ring[before][1] = after;
                ring[after][0] = before;
                inward.retain(|&i| i != before && i != after);
                inward.extend([before, after].into_iter().filter(|&i| turn(&ring, i) <= 0.0));
                left -= 1;
                tried = 0;
                // Not the next but the one after, or one corner would get all the triangles.
                at = ring[after][1];
            } else {
                tried += 1;
                at = after;
            }
        }
        let rest: Vec<u32> = std::iter::successors(Some(at), |&i| Some(ring[i][1])).take(left).map(|i| corners[i]).collect();
        fan(&rest, triangles);
        Ok(())
    }
}

fn fan(corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    triangles.extend(corners.windows(2).skip(1).map(|w| [corners[0], w[0], w[1]]));
}

/// The triangles of a strip, all turning as the first does.
pub(crate) fn strip(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    corners.windows(3).enumerate().map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] })
}

/// The polygon along the axis it faces most, turning left; none if it turns left at every corner anyway, or has no area.
fn flattened(positions: &[Vec3]) -> Option<Vec<DVec2>> {
    let edge = |i: usize| positions[(i + 1) % positions.len()].as_dvec3() - positions[i % positions.len()].as_dvec3();
    let origin = positions.first()?.as_dvec3();
    // Newell's area vector.
    let normal: DVec3 = (1..positions.len()).map(|i| (positions[i].as_dvec3() - origin).cross(edge(i))).sum();
    let inwards = |i: &usize| {
        let (a, b) = (edge(*i), edge(i + 1));
        a.cross(b).dot(normal) < -STRAIGHT * a.length() * b.length() * normal.length()
    };
    (0..positions.len()).find(inwards)?;
    let axis = normal.abs().max_position();
    let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
    if normal[axis] < 0.0 {
        (u, v) = (v, u);
    }
    Some(positions.iter().map(|p| p.as_dvec3() - origin).map(|p| DVec2::new(p[u], p[v])).collect())
}

/// Twice the area of a triangle, positive if it turns left.
fn area(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

fn within(p: DVec2, [a, b, c]: [DVec2; 3]) -> bool {
    area(a, b, p) >= 0.0 && area(b, c, p) >= 0.0 && area(c, a, p) >= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles and area, which is the same from the other side.
    fn cut(outline: &[[f32; 2]]) -> (Vec<[u32; 3]>, f32) {
        let (above, below) = (cut_from(outline, 1.0), cut_from(outline, -1.0));
        assert_eq!(above, below);
        above
    }

    fn cut_from(outline: &[[f32; 2]], side: f32) -> (Vec<[u32; 3]>, f32) {
        let positions: Vec<Vec3> = outline.iter().map(|p| Vec3::new(p[0], 7.0, -p[1] * side)).collect();
        let corners: Vec<u32> = (0..positions.len() as u32).collect();
        let mut triangles = Vec::new();
        Cutter::default().cut(&corners, &positions, &mut triangles).expect("little effort");
        let areas = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            0.5 * side * (b - a).cross(c - a).y
        });
        assert!(areas.clone().all(|a| a >= 0.0), "one is turned over: {triangles:?}");
        let sum = areas.sum();
        (triangles, sum)
    }

    #[test]
    fn convex_polygons_are_fans() {
        assert_eq!(cut(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), (vec![[0, 1, 2], [0, 2, 3]], 1.0));
        // A corner in the middle of a side does not make it concave.
        assert_eq!(cut(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 2.0]]).0, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn concave_polygons_are_cut_inside() {
        let arrow = [[0.0, 0.0], [2.0, 0.0], [0.5, 0.5], [0.0, 2.0]];
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let comb: Vec<[f32; 2]> = (0..20).map(|i| [i as f32, [0.0, 9.0][i % 2]]).chain([[19.0, 10.0], [0.0, 10.0], [0.0, 5.0]]).collect();
        // A hole, reached by a bridge there and back.
        let ring = [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0], [0.0, 0.0], [1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [2.0, 1.0], [1.0, 1.0]];
        for outline in [&arrow[..], &l, &comb, &ring] {
            // Shoelaces; whichever corner comes first.
            let at = |i: usize| DVec2::new(outline[i % outline.len()][0].into(), outline[i % outline.len()][1].into());
            let whole: f64 = (0..outline.len()).map(|i| 0.5 * at(i).perp_dot(at(i + 1))).sum();
            for first in 0..outline.len() {
                let turned: Vec<[f32; 2]> = (0..outline.len()).map(|i| outline[(first + i) % outline.len()]).collect();
                let (triangles, sum) = cut(&turned);
                assert_eq!(triangles.len(), outline.len() - 2);
                assert!((f64::from(sum) - whole).abs() < 1e-5, "{sum} of {whole}: {triangles:?}");
            }
        }
    }

    #[test]
    fn a_senseless_polygon_gives_as_many_triangles() {
        let star = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0], [1.0, -1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let corners = [0, 1, 2, 3, 4];
        for positions in [star, [Vec3::ONE; 5], [0.0, 1.0, 2.0, 3.0, 4.0].map(Vec3::splat)] {
            let mut triangles = Vec::new();
            Cutter::default().cut(&corners, &positions, &mut triangles).expect("little effort");
            assert_eq!(triangles.len(), 3);
        }
    }

    #[test]
    fn effort_has_an_end() {
        let comb: Vec<Vec3> = (0..4001).map(|i| Vec3::new(i as f32, [0.0, 9.0][i % 2], 0.0)).collect();
        let corners: Vec<u32> = (0..4001).collect();
        let mut cutter = Cutter { effort: 1000 };
        let error = cutter.cut(&corners, &comb, &mut Vec::new());
        assert_eq!(error.err().as_deref(), Some("the 4001 corners of this face and those before are too much to cut"));
    }
}
