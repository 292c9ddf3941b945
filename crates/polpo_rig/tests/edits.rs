//! What an artist changed by hand comes out as told, and the rest stays as it was.

mod common;

use common::{WHEELS, block, pieces, settings, truck, two_fingers};
use glam::Vec3;
use polpo_rig::{Built, EdgeAmount, Edit, Mesh, Note, Recipe, RegionRule, Rig, build_rig, build_rig_with};

fn built(mesh: &Mesh, particles: usize, edits: &[Edit]) -> Built {
    let recipe = Recipe { edits: edits.to_vec(), ..settings(particles) };
    build_rig_with(mesh, &recipe, &mut |_| {}).expect("the shape can be rigged")
}

/// The rig, in which all edits were done.
fn edited(mesh: &Mesh, particles: usize, edits: &[Edit]) -> Rig {
    let Built { rig, notes } = built(mesh, particles, edits);
    assert_eq!(notes, []);
    assert_eq!(pieces(&rig), 1);
    rig
}

fn place(rig: &Rig, particle: usize) -> [f32; 3] {
    rig.particles[particle].position.to_array()
}

fn nearest(rig: &Rig, to: [f32; 3]) -> usize {
    let distance = |p: &usize| rig.particles[*p].position.distance(to.into());
    (0..rig.particles.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("particles")
}

fn pair(a: usize, b: usize) -> [u32; 2] {
    [a.min(b) as u32, a.max(b) as u32]
}

fn mass(rig: &Rig) -> f32 {
    rig.particles.iter().map(|p| p.mass).sum()
}

/// Every vertex lies in or near one of the ellipsoids that it follows: what was made after the edit was made for it.
fn fits(rig: &Rig, mesh: &Mesh) {
    for (&vertex, influences) in mesh.positions.iter().zip(&rig.skin) {
        let near = influences.used().any(|(particle, _)| {
            let p = &rig.particles[particle as usize];
            (p.frame.inverse() * (vertex - p.position) / p.radii).length() < 1.8
        });
        assert!(near, "{vertex} follows {influences:?}");
    }
}

#[test]
fn a_particle_is_moved_and_the_others_stay() {
    let mesh = two_fingers(0.1);
    let plain = edited(&mesh, 40, &[]);
    // Halfway to a neighbour.
    let [a, b] = plain.edges[20].map(|p| p as usize);
    let to = plain.particles[a].position.lerp(plain.particles[b].position, 0.4);
    let rig = edited(&mesh, 40, &[Edit::Move([place(&plain, a), to.to_array()])]);
    for p in 0..40 {
        let expected = if p == a { to } else { plain.particles[p].position };
        assert!(rig.particles[p].position.distance(expected) < 1e-6, "{p}");
    }
    assert!((mass(&rig) / mass(&plain) - 1.0).abs() < 1e-5);
    // It takes of the cell that it came near to.
    assert!(rig.particles[b].mass < 0.9 * plain.particles[b].mass, "{} of {} kg", rig.particles[b].mass, plain.particles[b].mass);
    fits(&rig, &mesh);
}

#[test]
fn particles_are_added_and_removed() {
    let mesh = two_fingers(0.1);
    let plain = edited(&mesh, 40, &[]);
    let [a, b] = plain.edges[20].map(|p| p as usize);
    let between = plain.particles[a].position.lerp(plain.particles[b].position, 0.5);
    let more = edited(&mesh, 40, &[Edit::Add(between.to_array())]);
    assert_eq!(more.particles.len(), 41);
    assert!(more.particles[40].position.distance(between) < 1e-6);
    assert!(more.edges.iter().any(|e| e[1] == 40) && more.skin.iter().any(|i| i.used().any(|(p, w)| p == 40 && w > 0.1)));
    let fewer = edited(&mesh, 40, &[Edit::Remove(place(&plain, 7))]);
    assert_eq!(fewer.particles.len(), 39);
    for p in 0..39 {
        assert_eq!(fewer.particles[p].position, plain.particles[p + usize::from(p >= 7)].position);
    }
    for rig in [more, fewer] {
        assert!((mass(&rig) / mass(&plain) - 1.0).abs() < 1e-5);
        fits(&rig, &mesh);
    }
}

#[test]
fn edges_are_tied_and_cut() {
    let mesh = two_fingers(0.1);
    let plain = edited(&mesh, 40, &[]);
    // The tips of the fingers, which have none.
    let tips = [nearest(&plain, [-0.11, 1.2, 0.1]), nearest(&plain, [0.2, 1.2, 0.1])];
    let tie = Edit::Connect(tips.map(|p| place(&plain, p)));
    let rig = edited(&mesh, 40, &[tie, tie]);
    assert_eq!(rig.edges.len(), plain.edges.len() + 1);
    assert!(rig.edges.contains(&pair(tips[0], tips[1])));
    assert_eq!((&rig.particles, &rig.skin), (&plain.particles, &plain.skin));
    let cut = plain.edges[9];
    let rig = edited(&mesh, 40, &[Edit::Disconnect(cut.map(|p| place(&plain, p as usize)))]);
    assert_eq!(rig.edges, plain.edges.iter().copied().filter(|&e| e != cut).collect::<Vec<_>>());
}

/// Where a material pulls by facets, these are tied and cut.
#[test]
fn facets_are_tied_and_cut() {
    let mesh = two_fingers(0.1);
    let material = Recipe::from_toml("test", "[material]\nyoungs_modulus = 1e6").expect("a recipe").material;
    let made = |edits: Vec<Edit>| build_rig(&mesh, &Recipe { edits, material, ..settings(40) }).expect("a rig");
    let plain = made(vec![]);
    let facets = |rig: &Rig| rig.cells.as_ref().expect("it has a material").facets.iter().map(|f| f.pair).collect::<Vec<_>>();
    let before = facets(&plain);
    let tips = [nearest(&plain, [-0.11, 1.2, 0.1]), nearest(&plain, [0.2, 1.2, 0.1])];
    assert!(!before.contains(&pair(tips[0], tips[1])));
    let tied = facets(&made(vec![Edit::Connect(tips.map(|p| place(&plain, p)))]));
    assert!(tied.len() == before.len() + 1 && tied.contains(&pair(tips[0], tips[1])));
    let cut = *plain.edges.iter().filter(|edge| before.contains(edge)).nth(9).expect("edges are between cells that touch");
    let left = facets(&made(vec![Edit::Disconnect(cut.map(|p| place(&plain, p as usize)))]));
    assert_eq!(left, before.iter().copied().filter(|&f| f != cut).collect::<Vec<_>>());
}

/// Each place means what the edits before it have left, edges come last, and the same recipe gives the same bytes.
#[test]
fn edits_build_on_each_other() {
    let mesh = two_fingers(0.1);
    let plain = edited(&mesh, 30, &[]);
    let [a, b] = plain.edges[12].map(|p| p as usize);
    let between = plain.particles[a].position.lerp(plain.particles[b].position, 0.5).to_array();
    let further = plain.particles[a].position.lerp(plain.particles[b].position, 0.55).to_array();
    let far = place(&plain, nearest(&plain, [0.2, 1.2, 0.1]));
    let edits = [Edit::Connect([further, far]), Edit::Add(between), Edit::Move([between, further]), Edit::Remove(place(&plain, b))];
    let rig = edited(&mesh, 30, &edits);
    let added = nearest(&rig, further);
    assert_eq!((rig.particles.len(), added), (30, 29));
    assert!(rig.edges.contains(&pair(added, nearest(&rig, far))));
    assert_eq!(rig.to_postcard().expect("bytes"), edited(&mesh, 30, &edits).to_postcard().expect("bytes"));
}

#[test]
fn what_cannot_be_done_is_left_and_told() {
    let limb = block([12, 1, 1], 1, Vec3::new(3.0, 0.25, 0.25));
    let recipe = Recipe { edges: EdgeAmount::Count(5), ..settings(6) };
    let plain = build_rig(&limb, &recipe).expect("a rig");
    let at = |p| place(&plain, p);
    let out = [9.0, 0.0, 0.0];
    let edits = vec![
        Edit::Remove(out),
        Edit::Connect([at(1), at(1)]),
        Edit::Disconnect([at(0), at(5)]),
        Edit::Add(at(3)),
        Edit::Move([at(2), at(3)]),
        Edit::Move([at(2), out]),
        // All edges of a chain are needed.
        Edit::Disconnect(plain.edges[0].map(|p| at(p as usize))),
        Edit::Move([at(4), [at(4)[0], 0.125, 0.6]]),
        Edit::Add([0.1, 0.1, 0.1]),
    ];
    let Built { rig, notes } = build_rig_with(&limb, &Recipe { edits, ..recipe }, &mut |_| {}).expect("a rig");
    let told: Vec<String> = notes.iter().map(ToString::to_string).collect();
    let expected = [
        "edit 0: no particle is near that place",
        "edit 1: both places mean the same particle",
        "edit 2: there is no edge between these particles",
        "edit 3: there is a particle at that place",
        "edit 4: there is a particle at that place",
        "edit 5: no particle is near that place",
        "edit 6: without this edge the body would fall apart",
        "edit 7: the place is not in the body",
    ];
    assert_eq!(told, expected);
    assert_eq!((rig.particles.len(), pieces(&rig)), (7, 1));
}

/// A region keeps a particle, and what is added in it belongs to it.
#[test]
fn regions_and_edits_get_along() {
    let wheel = RegionRule { name: "wheel".into(), node: Some("Wheel 0".into()), ..RegionRule::default() };
    let recipe = |edits| Recipe { regions: vec![wheel.clone()], edits, ..settings(24) };
    let rig = |edits| build_rig_with(&truck(), &recipe(edits), &mut |_| {}).expect("a rig");
    let plain = rig(Vec::new()).rig;
    let members = plain.regions[0].particles.clone();
    let all = members.iter().map(|&p| Edit::Remove(place(&plain, p as usize))).collect();
    let Built { rig: bare, notes } = rig(all);
    assert_eq!(notes, [Note::EditLeft { edit: members.len() - 1, what: "it is the last particle of its part or region" }]);
    assert_eq!(bare.regions[0].particles.len(), 1);
    let inside = (Vec3::from(WHEELS[0]) + Vec3::new(0.1, 0.1, 0.05)).to_array();
    let Built { rig: more, notes } = rig(vec![Edit::Add(inside)]);
    assert_eq!(notes, []);
    assert_eq!(more.regions[0].particles, [&members[..], &[24]].concat());
}

/// The same edits on a mesh that has become 5 % longer change what is nearest to the same places.
#[test]
fn a_changed_mesh_takes_the_same_edits() {
    let mesh = two_fingers(0.1);
    let plain = edited(&mesh, 30, &[]);
    let longer = Mesh { positions: mesh.positions.iter().map(|&p| p * Vec3::new(1.0, 1.05, 1.0)).collect(), ..mesh.clone() };
    let before = edited(&longer, 30, &[]);
    let tips = [[-0.11, 1.2, 0.1], [0.2, 1.2, 0.1]].map(|tip| place(&plain, nearest(&plain, tip)));
    let middle = place(&plain, nearest(&plain, [-0.11, 0.6, 0.1]));
    let aside = (Vec3::from(middle) + Vec3::new(0.02, 0.05, 0.0)).to_array();
    let foot = place(&plain, nearest(&plain, [0.2, 0.1, 0.1]));
    let rig = edited(&longer, 30, &[Edit::Connect(tips), Edit::Move([middle, aside]), Edit::Remove(foot)]);
    let removed = nearest(&before, foot);
    let now = |p: usize| p - usize::from(p > removed);
    let moved = now(nearest(&before, middle));
    for p in (0..30).filter(|&p| p != removed) {
        let expected = if now(p) == moved { aside.into() } else { before.particles[p].position };
        assert!(rig.particles[now(p)].position.distance(expected) < 1e-6, "{p}");
    }
    let [a, b] = tips.map(|tip| now(nearest(&before, tip)));
    assert!(rig.edges.contains(&pair(a, b)));
    fits(&rig, &longer);
}
