// Poses deforming bodies, and refits their trees.  The scene runs it once a frame for the bodies whose pose changed, before all views.

#import bevy_restir::deformation::bindings::bodies
#import bevy_restir::deformation::pose::{add_triangle, pose_vertex}
#import bevy_restir::deformation::refit::{node_at, nodes_of_level, refit_node}
#import bevy_restir::deformation::types::BODY_APPEARED

const WORKGROUP: u32 = 64u;

// An invocation poses a vertex of body y, and adds a triangle of it if it is new.
@compute @workgroup_size(WORKGROUP)
fn pose(@builtin(global_invocation_id) id: vec3<u32>) {
    let body = bodies[id.y];
    if id.x < body.vertex_count {
        pose_vertex(body, id.x);
    }
    if id.x < body.triangle_count && (body.flags & BODY_APPEARED) != 0u {
        add_triangle(body, id.x);
    }
}

// A workgroup refits a body, level by level from the deepest to the root, because a node needs the boxes of its children.
@compute @workgroup_size(WORKGROUP)
fn refit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let body = bodies[group.x];
    for (var level = 0u; level < body.level_count; level += 1u) {
        let range = nodes_of_level(body, level);
        for (var i = range.x + lane; i < range.y; i += WORKGROUP) {
            refit_node(body, node_at(i));
        }
        storageBarrier();
    }
}
