//! A tree of boxes (bounding volume hierarchy, cut at the median), for whatever is near a point.

use glam::DVec3;

/// As many items as a leaf holds.
const LEAF: usize = 4;

/// A box along the axes: lowest and highest corner.
pub(crate) type Bounds = (DVec3, DVec3);

/// Boxes of items, and boxes around these.
pub(crate) struct Tree {
    nodes: Vec<Node>,
    /// The items in the order of the leaves.
    items: Vec<u32>,
}

struct Node {
    bounds: Bounds,
    /// The items below it.
    from: u32,
    to: u32,
    /// The second of its children; the first one follows it. 0 for a leaf.
    second: u32,
}

impl Tree {
    /// A tree over the boxes of items 0, 1, ….
    pub(crate) fn new(bounds: &[Bounds]) -> Tree {
        let mut tree = Tree { nodes: Vec::new(), items: (0..bounds.len() as u32).collect() };
        if !bounds.is_empty() {
            tree.grow(bounds, 0, bounds.len());
        }
        tree
    }

    fn grow(&mut self, bounds: &[Bounds], from: usize, to: usize) -> u32 {
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let middle = |i: u32| bounds[i as usize].0 + bounds[i as usize].1;
        let (mut around, mut middles) = (none, none);
        for &i in &self.items[from..to] {
            let (low, high) = bounds[i as usize];
            around = (around.0.min(low), around.1.max(high));
            middles = (middles.0.min(middle(i)), middles.1.max(middle(i)));
        }
        let at = self.nodes.len();
        self.nodes.push(Node { bounds: around, from: from as u32, to: to as u32, second: 0 });
        if to - from > LEAF {
            let axis = (middles.1 - middles.0).max_position();
            let half = (to - from) / 2;
            self.items[from..to].select_nth_unstable_by(half, |&a, &b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(&b)));
            self.grow(bounds, from, from + half);
            self.nodes[at].second = self.grow(bounds, from + half, to);
        }
        at as u32
    }

    /// Calls `visit` for the items whose boxes are at most `reach` from a point; it gives back the reach from there on. A negative one ends it.
    pub(crate) fn near(&self, point: DVec3, mut reach: f64, mut visit: impl FnMut(u32) -> f64) {
        let distance = |node: u32| {
            let (low, high) = self.nodes[node as usize].bounds;
            (low - point).max(point - high).max(DVec3::ZERO).length()
        };
        let mut stack: Vec<(f64, u32)> = if self.nodes.is_empty() { Vec::new() } else { vec![(distance(0), 0)] };
        while let Some((apart, at)) = stack.pop() {
            if apart > reach {
                continue;
            }
            let node = &self.nodes[at as usize];
            if node.second == 0 {
                for &item in &self.items[node.from as usize..node.to as usize] {
                    reach = visit(item);
                }
                continue;
            }
            let [a, b] = [at + 1, node.second].map(|child| (distance(child), child));
            // The nearer one comes first.
            stack.extend(if a.0 <= b.0 { [b, a] } else { [a, b] });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_found() {
        let points: Vec<DVec3> =
            (0..500).map(|i| DVec3::new(f64::from(i * 37 % 101), f64::from(i * 53 % 89), f64::from(i * 11 % 17))).collect();
        let tree = Tree::new(&points.iter().map(|&p| (p, p)).collect::<Vec<_>>());
        for i in 0..50 {
            let at = DVec3::new(f64::from(i * 29 % 103), f64::from(i * 31 % 71), f64::from(i % 13)) + 0.25;
            let mut nearest = f64::INFINITY;
            tree.near(at, nearest, |item| {
                nearest = nearest.min(points[item as usize].distance(at));
                nearest
            });
            let expected = points.iter().map(|p| p.distance(at)).fold(f64::INFINITY, f64::min);
            assert_eq!(nearest, expected);
        }
        Tree::new(&[]).near(DVec3::ZERO, 1.0, |_| unreachable!("there is none"));
    }
}
