//! The strains of a calibrated edge and what they change with, in `f64`.

use glam::{DMat3, DQuat, DVec3};

use crate::CalibratedEdges;

/// cos ½θ of the angle θ between the ends beyond which the long way round is looked at too.
pub(crate) const BENT: f64 = 0.9;

/// The strains γ and φ of an edge; [`solve_calibrated_edges`](crate::solve_calibrated_edges) defines them.
pub(crate) struct EdgeStrain {
    /// The edge's axes, R.
    pub(crate) axes: DMat3,
    /// γ \[m\] and φ \[rad\].
    pub(crate) strain: [DVec3; 2],
    /// 1 + |φ|²/16
    pub(crate) steep: f64,
    /// The gap between the contact points, in the world's axes, and the arms at which its middle lies.
    gap: DVec3,
    arm: [DVec3; 2],
}

impl EdgeStrain {
    /// Of edge `e`, between ends at `position` with the `rotation` since rest.
    pub(crate) fn new(edges: &CalibratedEdges, e: usize, position: [DVec3; 2], rotation: [DQuat; 2]) -> Self {
        let [qi, qj] = rotation;
        let mut gap = position[1] - position[0];
        let mut arm = [DVec3::ZERO; 2];
        if let Some(contact) = edges.contact.get(e) {
            arm = [qi * contact[0].as_dvec3(), qj * contact[1].as_dvec3()];
            gap += arm[1] - arm[0];
        }
        arm[0] += gap * 0.5;
        arm[1] -= gap * 0.5;
        let (qi, qj) = match edges.rest_turn.get(e) {
            Some(&[back_i, back_j]) => (qi * back_i.as_dquat(), qj * back_j.as_dquat()),
            None => (qi, qj),
        };
        let seen_as = |qj: DQuat| {
            let axes = DMat3::from_quat(((qi + qj).normalize() * edges.frame[e].as_dquat()).normalize());
            let p = qj * qi.inverse();
            let bend = DVec3::new(p.x, p.y, p.z) * (4.0 / (1.0 + p.w));
            let strain = [axes.transpose() * gap - edges.rest_gap[e].as_dvec3(), axes.transpose() * bend];
            Self { axes, strain, steep: 1.0 + bend.length_squared() / 16.0, gap, arm }
        };
        let near = qi.dot(qj);
        let short = seen_as(if near < 0.0 { -qj } else { qj });
        if near.abs() > BENT {
            return short;
        }
        let long = seen_as(if near < 0.0 { qj } else { -qj });
        if long.energy(edges, e) < short.energy(edges, e) { long } else { short }
    }

    /// ½·Cᵀ·S·C \[J\]
    pub(crate) fn energy(&self, edges: &CalibratedEdges, e: usize) -> f64 {
        let [stretch, bend] = [edges.stretch_compliance[e], edges.bend_compliance[e]].map(|c| c.as_dvec3().recip());
        0.5 * (self.strain[0] * self.strain[0]).dot(stretch) + 0.5 * (self.strain[1] * self.strain[1]).dot(bend)
    }

    /// What γ changes with, in the world's axes: the first end's way and turn, and the second's.
    ///
    /// δg = δx_j + θ_j×(q_j·s_j) − δx_i − θ_i×(q_i·s_i), and R turns by ½(θ_i + θ_j) + ⅛Φ×(θ_i − θ_j), so R·δγ = δx_j − δx_i + θ_j×a_j − θ_i×a_i + ⅛g×(Φ×(θ_i − θ_j)).
    pub(crate) fn gradient(&self) -> [DMat3; 4] {
        let turning = cross(self.gap) * cross(self.axes * self.strain[1]) * 0.125;
        [-DMat3::IDENTITY, cross(self.arm[0]) + turning, DMat3::IDENTITY, -cross(self.arm[1]) - turning]
    }
}

/// The rotation p with 4·vec(p)/(1 + p_w) = `turn`: by |turn|, to second order in it.
pub(crate) fn rotation_by(turn: DVec3) -> DQuat {
    let t = turn * 0.25;
    let t2 = t.length_squared();
    DQuat::from_xyzw(2.0 * t.x, 2.0 * t.y, 2.0 * t.z, 1.0 - t2) * (1.0 / (1.0 + t2))
}

/// a× as a matrix.
fn cross(a: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, a.z, -a.y), DVec3::new(-a.z, 0.0, a.x), DVec3::new(a.y, -a.x, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;
    use glam::Vec3A;

    /// Against central differences, with ends turned against each other by up to 100°.
    #[test]
    fn strains_change_as_their_gradients_say() {
        let mut random = Random(9);
        for _ in 0..100 {
            let mut vector = |size: f64| random.vector().as_dvec3() * size;
            let contact = [vector(0.5).as_vec3a(), vector(0.5).as_vec3a()];
            let frame = rotation_by(vector(2.0)).as_quat().normalize();
            let soft = vec![Vec3A::ONE];
            let edges = CalibratedEdges {
                contact: vec![contact],
                frame: vec![frame],
                rest_gap: vec![Vec3A::X],
                stretch_compliance: soft.clone(),
                bend_compliance: soft,
                ..Default::default()
            };
            let position = [vector(1.0), vector(1.0)];
            let rotation = [rotation_by(vector(1.0)), rotation_by(vector(1.0))];
            let here = EdgeStrain::new(&edges, 0, position, rotation);
            let change = [vector(1.0), vector(1.0), vector(1.0), vector(1.0)];
            let at = |h: f64| {
                let x = [position[0] + change[0] * h, position[1] + change[2] * h];
                let q = [rotation_by(change[1] * h) * rotation[0], rotation_by(change[3] * h) * rotation[1]];
                EdgeStrain::new(&edges, 0, x, q).strain
            };
            let (plus, minus) = (at(1e-5), at(-1e-5));
            let expected = here.gradient().iter().zip(&change).fold(DVec3::ZERO, |sum, (g, c)| sum + *g * *c);
            let got = here.axes * (plus[0] - minus[0]) / 2e-5;
            assert!(got.distance(expected) < 1e-7, "{got} {expected}");
            let expected = (change[3] - change[1]) * here.steep;
            let got = here.axes * (plus[1] - minus[1]) / 2e-5;
            assert!(got.distance(expected) < 1e-7, "{got} {expected}");
        }
    }
}
