// SPDX-License-Identifier: MIT
// Boxes of nodes, one instance each, a little larger than they are (box_test.c says how much).
struct box_record {
	vec4 box_min; // from the anchor; w: 0
	vec4 box_max;
};

layout(std430, binding = 0) readonly buffer box_table
{
	box_record boxes[];
};

layout(location = 0) uniform vec4 clip_rows[4];
layout(location = 4) uniform vec4 tile; // of the picture: scale x, y, shift x, y
layout(location = 5) uniform uint first_box;

flat out uint box_number;

// Corners (bit 0: x, 1: y, 2: z at the maximum) of two triangles a side, counter-clockwise from outside.
const uint corners[36] = uint[36](0u, 4u, 6u, 0u, 6u, 2u, 1u, 3u, 7u, 1u, 7u, 5u,  // x
				  0u, 1u, 5u, 0u, 5u, 4u, 2u, 6u, 7u, 2u, 7u, 3u,  // y
				  0u, 2u, 3u, 0u, 3u, 1u, 4u, 5u, 7u, 4u, 7u, 6u); // z

void main()
{
	uint corner = corners[gl_VertexID];
	vec4 clip;

	box_number = first_box + uint(gl_InstanceID);
	vec4 p = vec4(mix(boxes[box_number].box_min.xyz, boxes[box_number].box_max.xyz,
			  bvec3((corner & 1u) != 0u, (corner & 2u) != 0u, (corner & 4u) != 0u)),
		      1.0);
	clip = vec4(dot(clip_rows[0], p), dot(clip_rows[1], p), dot(clip_rows[2], p),
		    dot(clip_rows[3], p));
	clip.x = tile.x * clip.x + tile.z * clip.w;
	clip.y = tile.y * clip.y + tile.w * clip.w;
	gl_Position = clip;
}
