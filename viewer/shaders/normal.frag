// SPDX-License-Identifier: MIT
layout(location = 0) out vec4 pixel;

void main()
{
	pixel = vec4(seen_normal(), 1.0);
}
