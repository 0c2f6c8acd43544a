// SPDX-License-Identifier: MIT
// Says of a box that a sample of it is not behind the depth: all boxes say so, not only the nearest.
layout(early_fragment_tests) in;

layout(std430, binding = 1) buffer shows_table
{
	uint shows[];
};

flat in uint box_number;

void main()
{
	shows[box_number] = 1u;
}
