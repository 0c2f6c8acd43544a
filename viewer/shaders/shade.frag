// SPDX-License-Identifier: MIT
// Two lights: one at the viewer's left shoulder, which shows form, and the sky, which tells up from
// down where the first one shines head-on.
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

	if (unlit != 0u) {
		pixel = vec4(surface_colour.rgb, 1.0);
		return;
	}
	n = seen_normal();
	albedo = pow(surface_colour.rgb, vec3(2.2));
	light = mix(vec3(0.16, 0.15, 0.14), vec3(0.42, 0.45, 0.50), 0.5 + 0.5 * dot(n, up));
	light += vec3(0.62, 0.60, 0.57) * max(dot(n, lamp), 0.0);
	sheen = 0.06 * pow(max(dot(n, normalize(lamp + to_eye())), 0.0), 24.0);
	pixel = vec4(pow(min(albedo * light + sheen, 1.0), vec3(1.0 / 2.2)), 1.0);
}
