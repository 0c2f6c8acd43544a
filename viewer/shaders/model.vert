// SPDX-License-Identifier: MIT
// A vertex as the payload has it, to the screen: camera.h says how, to the bit.  `precise` forbids
// the compiler to fuse or reorder, so that the software rasteriser gets the same clip position.
layout(location = 0) in vec3 position;
layout(location = 1) in uint run;
layout(location = 2) in vec2 normal;
layout(location = 3) in vec4 colour;

struct run_record {
	uint part;
	uint section;
	uint first_triangle;
	uint colour;
};

layout(std430, binding = 0) readonly buffer run_table
{
	run_record runs[];
};

layout(location = 0) uniform vec4 clip_rows[4];
layout(location = 4) uniform vec4 tile;           // of the picture: scale x, y, shift x, y
layout(location = 5) uniform vec4 node_transform; // offset, scale
layout(location = 6) uniform uvec4 node_item;     // flags, node, store, number

const uint HAS_NORMAL = 1u;
const uint HAS_COLOUR = 2u;

out vec3 surface_point; // from the anchor
out vec3 surface_normal;
out vec4 surface_colour; // sRGB
flat out uint surface_part;

invariant gl_Position;

// Octahedral map: Cigolle et al. 2014.
vec3 decode_octahedral(vec2 coded)
{
	vec3 n = vec3(coded, 1.0 - abs(coded.x) - abs(coded.y));
	float fold = max(-n.z, 0.0);

	n.x += n.x >= 0.0 ? -fold : fold;
	n.y += n.y >= 0.0 ? -fold : fold;
	return normalize(n);
}

float clip_row(vec4 row, vec3 p)
{
	precise float sum = row.x * p.x;

	sum = sum + row.y * p.y;
	sum = sum + row.z * p.z;
	sum = sum + row.w;
	return sum;
}

void main()
{
	precise vec3 p = node_transform.w * position + node_transform.xyz;
	precise vec4 clip;
	run_record record = runs[run];

	clip.x = clip_row(clip_rows[0], p);
	clip.y = clip_row(clip_rows[1], p);
	clip.z = clip_row(clip_rows[2], p);
	clip.w = clip_row(clip_rows[3], p);
	// Whole pictures have the tile (1, 1, 0, 0), which changes no bit.
	clip.x = tile.x * clip.x + tile.z * clip.w;
	clip.y = tile.y * clip.y + tile.w * clip.w;
	gl_Position = clip;

	surface_point = p;
	surface_normal = (node_item.x & HAS_NORMAL) != 0u ? decode_octahedral(normal) : vec3(0.0);
	surface_colour = (node_item.x & HAS_COLOUR) != 0u ? colour : unpackUnorm4x8(record.colour);
	surface_part = record.part;
}
