// SPDX-License-Identifier: MIT
// A lamp above the viewer's left shoulder shows form; the sky tells up from down where the lamp does
// not reach; a little light from the eye keeps what faces the viewer from being black.
layout(location = 8) uniform vec3 lamp; // towards it, unit
layout(location = 9) uniform vec3 up;   // of the model, unit
layout(location = 10) uniform uint unlit;

layout(location = 0) out vec4 pixel;

void main()
{
	vec3 albedo;
	vec3 n;
	vec3 light;
	float sheen;

	seen_node = node_item.w;
	if (unlit != 0u) {
		pixel = vec4(surface_colour.rgb, 1.0);
		return;
	}
	n = seen_normal();
	albedo = pow(surface_colour.rgb, vec3(2.2));
	light = mix(vec3(0.16, 0.15, 0.15), vec3(0.50, 0.53, 0.57), 0.5 + 0.5 * dot(n, up));
	light += vec3(1.00, 0.97, 0.92) * max(dot(n, lamp), 0.0) + 0.15 * dot(n, to_eye());
	sheen = 0.06 * pow(max(dot(n, normalize(lamp + to_eye())), 0.0), 24.0);
	light = albedo * light + sheen;
	// Bends towards white instead of being cut off there.
	light = light / (1.0 + light) * (1.0 + light / (1.5 * 1.5));
	pixel = vec4(pow(min(light * 1.25, 1.0), vec3(1.0 / 2.2)), 1.0);
}
