// SPDX-License-Identifier: MIT
// Numbers instead of colours: which part, node or triangle a pixel shows.
layout(location = 11) uniform uint item; // enum channel

layout(std430, binding = 1) readonly buffer triangle_id_table
{
	uvec2 triangle_ids[]; // low, high
};

layout(location = 0) out uvec2 pixel; // low, high

const uint CHANNEL_PART = 1u;
const uint CHANNEL_NODE = 2u;

void main()
{
	seen_node = node_item.w;
	if (item == CHANNEL_PART)
		pixel = uvec2(surface_part, node_item.z);
	else if (item == CHANNEL_NODE)
		pixel = uvec2(node_item.y, node_item.z);
	else if ((node_item.x & HAS_TRIANGLE_ID) != 0u)
		pixel = triangle_ids[gl_PrimitiveID];
	else
		pixel = uvec2(uint(gl_PrimitiveID), node_item.y);
}
