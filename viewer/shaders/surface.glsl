// SPDX-License-Identifier: MIT
// What all fragments know of the surface they show.
in vec3 surface_point;
in vec3 surface_normal;
in vec4 surface_colour;
flat in uint surface_part;

layout(location = 6) uniform uvec4 node_item; // flags, node, store, number among all that are seen
layout(location = 7) uniform vec3 eye;        // from the anchor

layout(location = 1) out uint seen_node; // where the target wants to know

const uint HAS_NORMAL = 1u;
const uint HAS_TRIANGLE_ID = 4u;

vec3 to_eye()
{
	return normalize(eye - surface_point);
}

// The unit normal on the side that is seen: models do not agree on what is outside.
vec3 seen_normal()
{
	vec3 n = surface_normal;

	if ((node_item.x & HAS_NORMAL) == 0u)
		n = cross(dFdx(surface_point), dFdy(surface_point));
	n = normalize(n);
	return dot(n, to_eye()) < 0.0 ? -n : n;
}
