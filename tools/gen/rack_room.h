/* SPDX-License-Identifier: MIT */
/** rack_room.h - the shelves, walls and doors of a rack's room, as a model of its own. */
#ifndef TOOLS_GEN_RACK_ROOM_H
#define TOOLS_GEN_RACK_ROOM_H

#include "tools/gen/out_file.h"
#include "tools/gen/rack_place.h"

/**
 * A mesh_scene_fn.  In the room's own frame; without a roof, so that the scene shows something from
 * above.  Its groups are called as "room 3 / shelf", its materials as rack_room_materials() says.
 *
 * arg: a struct rack_room
 */
void rack_room_make(struct mesh *mesh, void *arg);

/** Writes the materials of all rooms in the MTL format. */
void rack_room_materials(struct out_file *out);

#endif /* TOOLS_GEN_RACK_ROOM_H */
