/* SPDX-License-Identifier: MIT */
/*
 * Unit vectors as points of an octahedron that is unfolded to a square.
 * Source: Cigolle, Donow, Evangelakos, Mara, McGuire & Meyer 2014, "A Survey of Efficient
 *	Representations for Independent Unit Vectors": "oct16" here as there; for 8 bits the "oct-P"
 *	variant, which takes the best of the four neighbours and halves the error.
 */
#include <math.h>

#include "formats/store/payload.h"

#define OCT16_MAX 32767.0f
#define OCT8_MAX  127.0f

static float sign_not_zero(float value)
{
	return signbit(value) ? -1.0f : 1.0f;
}

/* The point of the square, both coordinates -1 .. 1.  What is no direction becomes +Z. */
static void to_square(const float normal[3], float ret[2])
{
	float sum = fabsf(normal[0]) + fabsf(normal[1]) + fabsf(normal[2]);

	ret[0] = 0;
	ret[1] = 0;
	if (!(sum > 0) || !isfinite(sum))
		return;
	ret[0] = normal[0] / sum;
	ret[1] = normal[1] / sum;
	if (normal[2] < 0) {
		float x = ret[0];
		float y = ret[1];

		ret[0] = (1.0f - fabsf(y)) * sign_not_zero(x);
		ret[1] = (1.0f - fabsf(x)) * sign_not_zero(y);
	}
}

static void from_square(float x, float y, float ret[3])
{
	float z = 1.0f - fabsf(x) - fabsf(y);
	float length;

	if (z < 0) {
		float folded = (1.0f - fabsf(y)) * sign_not_zero(x);

		y = (1.0f - fabsf(x)) * sign_not_zero(y);
		x = folded;
	}
	length = sqrtf(x * x + y * y + z * z);
	ret[0] = x / length;
	ret[1] = y / length;
	ret[2] = z / length;
}

void payload_encode_oct16(const float normal[3], int16_t ret[2])
{
	float square[2];

	to_square(normal, square);
	for (unsigned i = 0; i < 2; i++)
		ret[i] = (int16_t)rintf(square[i] * OCT16_MAX);
}

void payload_decode_oct16(const int16_t coded[2], float ret[3])
{
	/* The least number, -32768, means -1 as well, as it does to GL. */
	from_square(fmaxf((float)coded[0] / OCT16_MAX, -1.0f),
		    fmaxf((float)coded[1] / OCT16_MAX, -1.0f), ret);
}

void payload_encode_oct8(const float normal[3], int8_t ret[2])
{
	float square[2];
	float unit[3];
	float best = -INFINITY;

	to_square(normal, square);
	from_square(square[0], square[1], unit);
	for (unsigned i = 0; i < 4; i++) {
		float x = floorf(square[0] * OCT8_MAX) + (float)(i & 1);
		float y = floorf(square[1] * OCT8_MAX) + (float)(i >> 1);
		float decoded[3];
		float likeness;

		if (x > OCT8_MAX || y > OCT8_MAX)
			continue;
		from_square(x / OCT8_MAX, y / OCT8_MAX, decoded);
		likeness = unit[0] * decoded[0] + unit[1] * decoded[1] + unit[2] * decoded[2];
		if (likeness > best) {
			best = likeness;
			ret[0] = (int8_t)x;
			ret[1] = (int8_t)y;
		}
	}
}

void payload_decode_oct8(const int8_t coded[2], float ret[3])
{
	from_square(fmaxf((float)coded[0] / OCT8_MAX, -1.0f),
		    fmaxf((float)coded[1] / OCT8_MAX, -1.0f), ret);
}
