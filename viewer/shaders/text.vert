// SPDX-License-Identifier: MIT
// One instance a rectangle: a character, or the panel behind a text.
layout(location = 0) in ivec4 rectangle; // x, y of its upper left corner, width, height: pixels
layout(location = 1) in vec4 colour;
layout(location = 2) in int glyph;

layout(location = 0) uniform vec2 screen;       // pixels
layout(location = 1) uniform vec2 glyph_pixels; // of the font

flat out int pixel_glyph;
flat out vec4 pixel_colour;
out vec2 glyph_point; // in the font's pixels

void main()
{
	vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
	vec2 p = (vec2(rectangle.xy) + corner * vec2(rectangle.zw)) / screen;

	pixel_glyph = glyph;
	pixel_colour = colour;
	glyph_point = corner * glyph_pixels;
	gl_Position = vec4(2.0 * p.x - 1.0, 1.0 - 2.0 * p.y, 0.0, 1.0);
}
