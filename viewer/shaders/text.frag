// SPDX-License-Identifier: MIT
layout(location = 2) uniform usampler2D font; // a row a glyph, a texel a row of it, a bit a pixel

flat in int pixel_glyph;
flat in vec4 pixel_colour;
in vec2 glyph_point;

layout(location = 0) out vec4 pixel;

const int GLYPH_PANEL = 0;

void main()
{
	ivec2 at = ivec2(glyph_point);

	if (pixel_glyph != GLYPH_PANEL &&
	    (texelFetch(font, ivec2(at.y, pixel_glyph), 0).r >> at.x & 1u) == 0u)
		discard;
	pixel = pixel_colour;
}
