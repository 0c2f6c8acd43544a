/* SPDX-License-Identifier: MIT */
#include "formats/import/placement.h"

const struct placement placement_identity = { { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0 } };

struct placement placement_multiply(const struct placement *a, const struct placement *b)
{
	struct placement product;

	for (int row = 0; row < 3; row++) {
		for (int column = 0; column < 4; column++) {
			double sum = column == 3 ? a->m[4 * row + 3] : 0.0;

			for (int k = 0; k < 3; k++)
				sum += a->m[4 * row + k] * b->m[4 * k + column];
			product.m[4 * row + column] = sum;
		}
	}
	return product;
}

double placement_cofactors(const struct placement *placement, double ret[9])
{
	const double *m = placement->m;

	for (int row = 0; row < 3; row++) {
		int r1 = 4 * ((row + 1) % 3), r2 = 4 * ((row + 2) % 3);

		for (int column = 0; column < 3; column++) {
			int c1 = (column + 1) % 3, c2 = (column + 2) % 3;

			ret[3 * row + column] = m[r1 + c1] * m[r2 + c2] - m[r1 + c2] * m[r2 + c1];
		}
	}
	return m[0] * ret[0] + m[1] * ret[1] + m[2] * ret[2];
}
