// Linear blend skinning into interleaved vertex buffers: one invocation per vertex and body. The derivation is in lib.rs, the mirror in cpu.rs.

// All bodies of one dispatch share a binding (and so the vertex count) and a target buffer.
struct Batch {
    first_job: u32,
    job_count: u32,
    groups_per_job: u32,
    vertex_count: u32,
    // The word at which the fifth to eighth influences start, NONE if no vertex has any.
    more: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

// One body. Offsets are in words of 32 bits: the body's first vertex, then per vertex.
struct Job {
    first_word: u32,
    stride: u32,
    position: u32,
    normal: u32,
    tangent: u32,
    first_transform: u32,
}

const NONE: u32 = 0xffffffffu;
const WORKGROUP_SIZE: u32 = 64u;
const REST_WORDS: u32 = 10u;
const DEGENERATE_LENGTH_SQUARED: f32 = 1e-12;

@group(0) @binding(0) var<uniform> batch: Batch;
// vertex_count records of REST_WORDS words (position, normal, 4 × u16 particles, 4 × unorm16 weights), then, if the mesh has tangents, vertex_count × 3 words, then, if some vertex has more
// influences than four, vertex_count × 4 words (4 × u16 particles, 4 × unorm16 weights).
@group(0) @binding(1) var<storage, read> rest: array<u32>;
@group(0) @binding(2) var<storage, read> jobs: array<Job>;
// Three rows of [s·R | t] per particle.
@group(0) @binding(3) var<storage, read> transforms: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> vertices: array<f32>;

fn rest_vector(word: u32) -> vec3<f32> {
    return bitcast<vec3<f32>>(vec3<u32>(rest[word], rest[word + 1u], rest[word + 2u]));
}

// The maps of four influences by their weights, on top of `sum`.
fn weighted(four: u32, first_transform: u32, sum: mat3x4<f32>) -> mat3x4<f32> {
    var rows = sum;
    for (var slot = 0u; slot < 4u; slot++) {
        let word = four + (slot >> 1u);
        let shift = (slot & 1u) * 16u;
        let particle = (rest[word] >> shift) & 0xffffu;
        let weight = f32((rest[word + 2u] >> shift) & 0xffffu) / 65535.0;
        let transform = (first_transform + particle) * 3u;
        rows[0] += weight * transforms[transform];
        rows[1] += weight * transforms[transform + 1u];
        rows[2] += weight * transforms[transform + 2u];
    }
    return rows;
}

fn blend_direction(rows: mat3x4<f32>, direction: vec3<f32>) -> vec3<f32> {
    let rotated = vec3<f32>(dot(rows[0].xyz, direction), dot(rows[1].xyz, direction), dot(rows[2].xyz, direction));
    let length_squared = dot(rotated, rotated);
    if length_squared > DEGENERATE_LENGTH_SQUARED {
        return rotated / sqrt(length_squared);
    }
    return direction;
}

fn write_vector(word: u32, vector: vec3<f32>) {
    vertices[word] = vector.x;
    vertices[word + 1u] = vector.y;
    vertices[word + 2u] = vector.z;
}

@compute @workgroup_size(WORKGROUP_SIZE)
fn skin(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    // A dispatch dimension holds 65535 groups, so long rows are folded into two.
    let group = workgroup.y * workgroups.x + workgroup.x;
    let job_index = group / batch.groups_per_job;
    let vertex = (group % batch.groups_per_job) * WORKGROUP_SIZE + local;
    if job_index >= batch.job_count || vertex >= batch.vertex_count {
        return;
    }
    let job = jobs[batch.first_job + job_index];

    let record = vertex * REST_WORDS;
    var rows = weighted(record + 6u, job.first_transform, mat3x4<f32>());
    if batch.more != NONE {
        rows = weighted(batch.more + vertex * 4u, job.first_transform, rows);
    }

    let base = job.first_word + vertex * job.stride;
    let position = vec4<f32>(rest_vector(record), 1.0);
    write_vector(base + job.position, vec3<f32>(dot(rows[0], position), dot(rows[1], position), dot(rows[2], position)));
    if job.normal != NONE {
        let normal = rest_vector(record + 3u);
        write_vector(base + job.normal, blend_direction(rows, normal));
    }
    if job.tangent != NONE {
        let tangent = rest_vector(batch.vertex_count * REST_WORDS + vertex * 3u);
        write_vector(base + job.tangent, blend_direction(rows, tangent));
    }
}
