// SPDX-License-Identifier: MIT
layout(location = 0) out vec4 pixel;

void main()
{
	seen_node = node_item.w;
	pixel = vec4(seen_normal(), 1.0);
}
