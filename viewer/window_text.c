/* SPDX-License-Identifier: MIT */
#include "viewer/window_text.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "formats/base/clock.h"
#include "formats/base/text.h"

const char window_text_help[] = "left drag      turn about the point under the cursor\n"
				"middle drag    move; or shift and left drag\n"
				"right drag     look around\n"
				"wheel          nearer to the point under the cursor\n"
				"click          name of the part\n"
				"\n"
				"W A S D        forward, left, backward, right\n"
				"R F            up, down\n"
				"arrows         turn\n"
				"Z X            roll;  L level\n"
				"shift, alt     faster, slower\n"
				"G              walk or fly\n"
				"\n"
				"0 or Home      the whole model\n"
				"1 2 3 4 5 6    front, back, left, right, top, bottom\n"
				"ctrl-C ctrl-V  copy, paste the camera\n"
				"space          play or stop the path\n"
				"\n"
				"M              full, approximate, conservative\n"
				"+ -            budget of triangles\n"
				"U              colours as they are\n"
				"P              picture into a file\n"
				"B              the cache from above: by state, place, level\n"
				"T              hide the numbers\n"
				"H              these keys\n"
				"Q              quit";

/* Adds to a text that may be full. */
static void __attribute__((format(printf, 2, 3))) add(char *buffer, const char *format, ...)
{
	size_t length = strlen(buffer);
	va_list args;

	va_start(args, format);
	(void)vsnprintf(buffer + length, WINDOW_TEXT_BYTES - length, format, args);
	va_end(args);
}

/* 1234567 as "1,234,567". */
static const char *grouped(uint64_t number, char buffer[32])
{
	char digits[24];
	size_t count = (size_t)snprintf(digits, sizeof(digits), "%" PRIu64, number);
	size_t length = 0;

	for (size_t i = 0; i < count; i++) {
		if (i > 0 && (count - i) % 3 == 0)
			buffer[length++] = ',';
		buffer[length++] = digits[i];
	}
	buffer[length] = '\0';
	return buffer;
}

static void add_units(char *buffer, const struct world *world)
{
	double metres = world->stores[0].superblock->unit_metres;

	if (!(metres > 0.0))
		add(buffer, "\nunits unknown");
	else if (metres == 1.0)
		add(buffer, "\nunits: metres");
	else if (metres < 1.0)
		add(buffer, "\nunits: 1 = %.6g mm", metres * 1000.0);
	else
		add(buffer, "\nunits: 1 = %.6g m", metres);
}

static void add_way(char *buffer, const struct window_text_facts *facts)
{
	const struct frame_report *report = facts->report;
	char number[32];

	switch (report->way) {
	case FRAME_WAY_FULL:
		add(buffer, "\nfull");
		return;
	case FRAME_WAY_EVERYTHING:
		add(buffer, "\napproximate, and all of it fits budget");
		break;
	case FRAME_WAY_BUDGET:
		add(buffer, "\napproximate by %s, budget", select_order_name(report->order));
		break;
	case FRAME_WAY_EXACT:
	case FRAME_WAY_NEARLY:
	case FRAME_WAY_UNTESTED:
		add(buffer, "\nconservative by %s%s%s",
		    frame_visibility_name(facts->style->visibility),
		    report->way == FRAME_WAY_NEARLY     ? " (approximate here)"
		    : report->way == FRAME_WAY_UNTESTED ? " (untested: most of it shows)"
							: "",
		    report->is_incomplete ? ", INCOMPLETE" : "");
		return;
	case FRAME_WAY_COUNT_:
		break;
	}
	add(buffer, " %s", grouped(report->budget_triangles, number));
	if (facts->fps > 0.0)
		add(buffer, " for %.6g fps", facts->fps);
}

const char *window_text_state(const struct window_text_facts *facts, char *buffer)
{
	const struct frame_report *report = facts->report;
	struct ooc_counters counters;
	char number[32];
	char other[32];
	char size[TEXT_SIZE_BYTES];
	char other_size[TEXT_SIZE_BYTES];
	uint64_t all = 0;

	for (uint32_t i = 0; i < facts->world->store_count; i++)
		all += facts->world->stores[i].superblock->triangle_count;
	ooc_counters(facts->world->client, &counters);
	buffer[0] = '\0';
	add(buffer, "%.1f ms  %s of %s triangles", report->ms, grouped(report->triangles, number),
	    grouped(all, other));
	add_way(buffer, facts);
	add(buffer, facts->is_walking ? ", walking" : ", flying");
	add(buffer, "\nnodes: %" PRIu64 " wanted, %" PRIu64 " drawn, %" PRIu64 " missing",
	    report->nodes_wanted, report->nodes_drawn, report->nodes_missing);
	add(buffer, "\ncache: %s of %s", text_from_size(counters.cache_used_bytes, size),
	    text_from_size(counters.cache_bytes, other_size));
	add(buffer, ", %s/s", text_from_size((uint64_t)llrint(facts->bytes_per_s), size));
	add_units(buffer, facts->world);
	add(buffer, "   H: keys");
	return buffer;
}

/* ---- bytes a second ---- */

#define SLOT_NS (NS_PER_S / WINDOW_RATE_SLOTS)

/* Empties the slots that time has left behind. */
static void advance(struct window_rate *rate, uint64_t now_ns)
{
	uint64_t slot = now_ns / SLOT_NS;

	if (slot - rate->slot >= WINDOW_RATE_SLOTS)
		memset(rate->bytes, 0, sizeof(rate->bytes));
	else
		for (uint64_t i = rate->slot + 1; i <= slot; i++)
			rate->bytes[i % WINDOW_RATE_SLOTS] = 0;
	rate->slot = slot;
}

void window_rate_add(struct window_rate *rate, uint64_t now_ns, uint64_t bytes)
{
	advance(rate, now_ns);
	rate->bytes[rate->slot % WINDOW_RATE_SLOTS] += bytes;
}

double window_rate_get(struct window_rate *rate, uint64_t now_ns)
{
	uint64_t sum = 0;

	advance(rate, now_ns);
	for (int i = 0; i < WINDOW_RATE_SLOTS; i++)
		sum += rate->bytes[i];
	return (double)sum;
}
