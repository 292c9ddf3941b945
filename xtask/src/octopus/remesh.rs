//! Evens a mesh out to wanted side lengths: split what is long, collapse what is short, flip towards Delaunay, relax along the
//! skin (the incremental remeshing of Botsch & Kobbelt, SGP 2004, with a length that varies over the shape).

use glam::DVec3;

use super::shape::Shape;

const ROUNDS: usize = 9;

pub(crate) struct Remesh {
    pub(crate) positions: Vec<DVec3>,
    /// A triangle that is gone is all `GONE`.
    triangles: Vec<[u32; 3]>,
    /// The triangles around each vertex; empty for a vertex that is gone.
    around: Vec<Vec<u32>>,
    /// The wanted side length at each vertex.
    side: Vec<f64>,
    /// Vertices that stay where they are.
    pinned: Vec<bool>,
}

const GONE: u32 = u32::MAX;

impl Remesh {
    pub(crate) fn new((positions, triangles): (Vec<DVec3>, Vec<[u32; 3]>)) -> Remesh {
        let mut around = vec![Vec::new(); positions.len()];
        for (t, corners) in triangles.iter().enumerate() {
            for &v in corners {
                around[v as usize].push(t as u32);
            }
        }
        let count = positions.len();
        Remesh { positions, triangles, around, side: vec![0.0; count], pinned: vec![false; count] }
    }

    pub(crate) fn even_out(&mut self, shape: &Shape) {
        for _ in 0..ROUNDS {
            self.side = self.positions.iter().map(|&p| shape.side(p)).collect();
            self.split(shape);
            self.collapse(shape);
            self.flip();
            self.relax(shape, 2);
        }
        self.flip();
    }

    /// Puts a vertex at a point of the skin that stays there: the nearest one if it is very near, or a new one in the triangle below.
    pub(crate) fn pin(&mut self, point: DVec3, shape: &Shape) {
        let distance = |v: u32| self.positions[v as usize].distance_squared(point);
        let alive = (0..self.positions.len() as u32).filter(|&v| !self.around[v as usize].is_empty());
        let Some(nearest) = alive.min_by(|&a, &b| distance(a).total_cmp(&distance(b))) else { return };
        let side = shape.side(point);
        if !self.pinned[nearest as usize] && distance(nearest) < 0.09 * side * side {
            self.positions[nearest as usize] = point;
            self.pinned[nearest as usize] = true;
            return;
        }
        // The triangle that holds the point is the one in which its smallest share of the area is largest.
        let inside = |t: u32| {
            let [a, b, c] = self.triangles[t as usize].map(|v| self.positions[v as usize]);
            let whole = self.normal([a, b, c]);
            let share = |p: DVec3, q: DVec3| self.normal([point, p, q]).dot(whole) / whole.length_squared();
            share(a, b).min(share(b, c)).min(share(c, a))
        };
        let mut near = self.around[nearest as usize].clone();
        near.extend(self.ring(nearest).iter().flat_map(|&v| &self.around[v as usize]));
        near.sort_unstable();
        near.dedup();
        let Some(t) = near.into_iter().max_by(|&s, &t| inside(s).total_cmp(&inside(t))) else { return };
        let new = self.positions.len() as u32;
        self.positions.push(point);
        self.side.push(side);
        self.pinned.push(true);
        self.around.push(vec![t]);
        let [a, b, c] = self.triangles[t as usize];
        self.triangles[t as usize] = [a, b, new];
        self.around[c as usize].retain(|&x| x != t);
        for corners in [[b, c, new], [c, a, new]] {
            for v in corners {
                self.around[v as usize].push(self.triangles.len() as u32);
            }
            self.triangles.push(corners);
        }
    }

    /// The mesh without the gaps.
    pub(crate) fn finish(self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let mut number = vec![GONE; self.positions.len()];
        let mut positions = Vec::new();
        for (v, around) in self.around.iter().enumerate() {
            if !around.is_empty() {
                number[v] = positions.len() as u32;
                positions.push(self.positions[v]);
            }
        }
        let alive = self.triangles.iter().filter(|t| t[0] != GONE);
        let triangles = alive.map(|t| t.map(|v| number[v as usize])).collect();
        (positions, triangles)
    }

    fn length(&self, [a, b]: [u32; 2]) -> f64 {
        self.positions[a as usize].distance(self.positions[b as usize])
    }

    /// Length in units of the wanted one.
    fn relative(&self, [a, b]: [u32; 2]) -> f64 {
        2.0 * self.length([a, b]) / (self.side[a as usize] + self.side[b as usize])
    }

    fn sides(&self) -> Vec<[u32; 2]> {
        let mut sides = Vec::new();
        for t in self.triangles.iter().filter(|t| t[0] != GONE) {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                if a < b {
                    sides.push([a, b]);
                }
            }
        }
        sides
    }

    /// The vertices around a vertex, sorted.
    fn ring(&self, v: u32) -> Vec<u32> {
        let corners = self.around[v as usize].iter().flat_map(|&t| self.triangles[t as usize]);
        let mut ring: Vec<u32> = corners.filter(|&c| c != v).collect();
        ring.sort_unstable();
        ring.dedup();
        ring
    }

    /// The two triangles at a side, if it still is one: first the one that walks it from a to b.
    fn pair(&self, [a, b]: [u32; 2]) -> Option<[u32; 2]> {
        let walks = |t: u32, from: u32, to: u32| {
            let c = self.triangles[t as usize];
            (0..3).any(|i| c[i] == from && c[(i + 1) % 3] == to)
        };
        let around = self.around.get(a as usize)?;
        let up = around.iter().copied().find(|&t| walks(t, a, b))?;
        let down = around.iter().copied().find(|&t| walks(t, b, a))?;
        Some([up, down])
    }

    fn apex(&self, t: u32, [a, b]: [u32; 2]) -> u32 {
        self.triangles[t as usize].into_iter().find(|&v| v != a && v != b).unwrap_or(GONE)
    }

    fn normal(&self, corners: [DVec3; 3]) -> DVec3 {
        (corners[1] - corners[0]).cross(corners[2] - corners[0])
    }

    fn split(&mut self, shape: &Shape) {
        for [a, b] in self.sides() {
            if self.relative([a, b]) < 4.0 / 3.0 {
                continue;
            }
            let Some(pair) = self.pair([a, b]) else { continue };
            let middle = shape.project((self.positions[a as usize] + self.positions[b as usize]) * 0.5);
            let m = self.positions.len() as u32;
            self.positions.push(middle);
            self.side.push(shape.side(middle));
            self.pinned.push(false);
            self.around.push(Vec::new());
            for t in pair {
                // The triangle keeps a; a new one takes b.
                let old = self.triangles[t as usize];
                let new = self.triangles.len() as u32;
                self.triangles[t as usize] = old.map(|v| if v == b { m } else { v });
                self.triangles.push(old.map(|v| if v == a { m } else { v }));
                self.around[b as usize].retain(|&x| x != t);
                self.around[b as usize].push(new);
                let apex = self.apex(t, [a, m]);
                self.around[apex as usize].push(new);
                self.around[m as usize].extend([t, new]);
            }
        }
    }

    fn collapse(&mut self, shape: &Shape) {
        for [a, b] in self.sides() {
            let Some(pair) = self.pair([a, b]) else { continue };
            let (pinned_a, pinned_b) = (self.pinned[a as usize], self.pinned[b as usize]);
            if self.relative([a, b]) > 0.8 || (pinned_a && pinned_b) {
                continue;
            }
            let (ring_a, ring_b) = (self.ring(a), self.ring(b));
            let shared = ring_a.iter().filter(|v| ring_b.binary_search(v).is_ok()).count();
            // Only then is the result a surface; and a vertex with three sides would fold on the next collapse.
            let apexes = pair.map(|t| self.apex(t, [a, b]));
            if shared != 2 || apexes.iter().any(|&v| self.around[v as usize].len() <= 3) {
                continue;
            }
            let (p, q) = (self.positions[a as usize], self.positions[b as usize]);
            let middle = match (pinned_a, pinned_b) {
                (true, _) => p,
                (_, true) => q,
                _ => shape.project((p + q) * 0.5),
            };
            let wanted = shape.side(middle);
            let long = |v: &u32| {
                let limit = (wanted + self.side[*v as usize]) * 0.5 * 4.0 / 3.0;
                *v != a && *v != b && self.positions[*v as usize].distance(middle) > limit
            };
            let folds = |v: u32| {
                self.around[v as usize].iter().filter(|t| !pair.contains(t)).any(|&t| {
                    let old = self.triangles[t as usize].map(|c| self.positions[c as usize]);
                    let corners = self.triangles[t as usize];
                    let new = corners.map(|c| if c == a || c == b { middle } else { self.positions[c as usize] });
                    self.normal(old).normalize_or_zero().dot(self.normal(new).normalize_or_zero()) < 0.4
                })
            };
            if ring_a.iter().any(long) || ring_b.iter().any(long) || folds(a) || folds(b) {
                continue;
            }
            self.positions[a as usize] = middle;
            self.side[a as usize] = wanted;
            self.pinned[a as usize] = pinned_a || pinned_b;
            for t in pair {
                for v in self.triangles[t as usize] {
                    self.around[v as usize].retain(|&x| x != t);
                }
                self.triangles[t as usize] = [GONE; 3];
            }
            for t in std::mem::take(&mut self.around[b as usize]) {
                self.triangles[t as usize] = self.triangles[t as usize].map(|v| if v == b { a } else { v });
                self.around[a as usize].push(t);
            }
        }
    }

    fn flip(&mut self) {
        for [a, b] in self.sides() {
            let Some([up, down]) = self.pair([a, b]) else { continue };
            let (c, d) = (self.apex(up, [a, b]), self.apex(down, [a, b]));
            let thin = self.around[a as usize].len() <= 3 || self.around[b as usize].len() <= 3;
            if thin || c == d || self.ring(c).binary_search(&d).is_ok() {
                continue;
            }
            let p = |v: u32| self.positions[v as usize];
            let old = self.normal([p(a), p(b), p(c)]).normalize_or_zero() + self.normal([p(b), p(a), p(d)]).normalize_or_zero();
            let new = [self.normal([p(a), p(d), p(c)]), self.normal([p(d), p(b), p(c)])];
            // Delaunay: the angles across from the side sum to more than half a turn. And a flip must not fold the surface.
            let angle = |v: u32| {
                let (to_a, to_b) = (p(a) - p(v), p(b) - p(v));
                (to_a.dot(to_b), to_a.cross(to_b).length())
            };
            let ((cos_c, sin_c), (cos_d, sin_d)) = (angle(c), angle(d));
            let wide = sin_c * cos_d + cos_c * sin_d < -1e-12;
            let fits = new.iter().all(|n| n.normalize_or_zero().dot(old.normalize_or_zero()) > 0.8);
            if !wide || !fits {
                continue;
            }
            self.triangles[up as usize] = [a, d, c];
            self.triangles[down as usize] = [d, b, c];
            self.around[a as usize].retain(|&t| t != down);
            self.around[b as usize].retain(|&t| t != up);
            self.around[c as usize].push(down);
            self.around[d as usize].push(up);
        }
    }

    /// Moves every vertex towards the middle of its triangles, by their areas in wanted units, along the skin.
    fn relax(&mut self, shape: &Shape, times: usize) {
        for _ in 0..times {
            let mut moved = self.positions.clone();
            for (v, place) in moved.iter_mut().enumerate() {
                if self.around[v].is_empty() || self.pinned[v] {
                    continue;
                }
                let (mut sum, mut total) = (DVec3::ZERO, 0.0);
                for &t in &self.around[v] {
                    let corners = self.triangles[t as usize];
                    let points = corners.map(|c| self.positions[c as usize]);
                    let side: f64 = corners.iter().map(|&c| self.side[c as usize]).sum();
                    let weight = self.normal(points).length() / (side * side);
                    sum += (points[0] + points[1] + points[2]) * (weight / 3.0);
                    total += weight;
                }
                if total > 0.0 {
                    let there = sum / total;
                    let here = self.positions[v];
                    let step = (there - here).reject_from_normalized(shape.normal(here));
                    *place = shape.project(here + step * 0.8);
                }
            }
            self.positions = moved;
        }
    }
}
