/* SPDX-License-Identifier: MIT */
#include "tools/bench/replay/schedule.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

/* A step while it is read. */
struct step {
	uint64_t *wants;
	size_t want_count;
	size_t want_room;
	uint64_t *wanted_at; /* an entry: 1 + the step that last began to want it */
	uint32_t wanted_room;
};

static int push(uint64_t **array, size_t *count, size_t *room, uint64_t value)
{
	if (*count == *room) {
		size_t wanted = *room + *room / 2 + 1024;
		uint64_t *grown = reallocarray(*array, wanted, sizeof(*grown));

		if (!grown)
			return -ENOMEM;
		*array = grown;
		*room = wanted;
	}
	(*array)[(*count)++] = value;
	return 0;
}

static int add_op(struct schedule *schedule, enum schedule_op op, uint32_t entry)
{
	return push(&schedule->ops, &schedule->op_count, &schedule->op_room,
		    (uint64_t)entry << 2 | op);
}

/* What was dropped stands in the ops already. */
static int end_step(struct schedule *schedule, struct step *step)
{
	int r = 0;

	if (schedule->op_count == 0 && step->want_count == 0)
		return 0;
	for (size_t i = 0; r == 0 && i < step->want_count; i++)
		r = add_op(schedule, SCHEDULE_WANT, (uint32_t)step->wants[i]);
	if (r == 0)
		r = add_op(schedule, SCHEDULE_STEP, 0);
	schedule->want_count += step->want_count;
	schedule->step_count++;
	step->want_count = 0;
	return r;
}

static int take_want(struct schedule *schedule, struct step *step, uint32_t entry)
{
	step->wanted_at[entry] = schedule->step_count + 1;
	return push(&step->wants, &step->want_count, &step->want_room, entry);
}

static int take_drop(struct schedule *schedule, struct step *step, uint32_t entry)
{
	int r = 0;

	/* Wanted and dropped by one step's messages, as when a client goes: in this order. */
	if (step->wanted_at[entry] == schedule->step_count + 1)
		r = end_step(schedule, step);
	return r < 0 ? r : add_op(schedule, SCHEDULE_DROP, entry);
}

static int take_node(struct step *step, uint32_t entry)
{
	uint64_t *grown;
	uint32_t room;

	if (entry < step->wanted_room)
		return 0;
	room = entry + entry / 2 + 1024;
	grown = reallocarray(step->wanted_at, room, sizeof(*grown));
	if (!grown)
		return -ENOMEM;
	memset(grown + step->wanted_room, 0, (room - step->wanted_room) * sizeof(*grown));
	step->wanted_at = grown;
	step->wanted_room = room;
	return 0;
}

static int take(struct schedule *schedule, struct step *step, const struct trace_event *event)
{
	schedule->seconds = (double)event->ticks / TRACE_TICKS_PER_S;
	if (event->kind == TRACE_NODE)
		return take_node(step, event->entry);
	if (event->kind == TRACE_HIT || event->kind == TRACE_MISS)
		return take_want(schedule, step, event->entry);
	if (event->kind == TRACE_DROP)
		return take_drop(schedule, step, event->entry);
	if (event->kind == TRACE_SET) {
		schedule->set_count++;
		return end_step(schedule, step);
	}
	if (event->kind == TRACE_BEGIN)
		schedule->viewer_count++;
	return 0;
}

static int keep_entries(struct schedule *schedule, const struct trace_reader *reader)
{
	schedule->entry_count = trace_reader_entry_count(reader);
	schedule->store_count = trace_reader_store_count(reader);
	schedule->was_cut = trace_reader_was_cut(reader);
	schedule->entries =
		malloc(((size_t)schedule->entry_count + 1) * sizeof(*schedule->entries));
	if (!schedule->entries)
		return -ENOMEM;
	for (uint32_t i = 0; i < schedule->entry_count; i++)
		schedule->entries[i] = *trace_reader_entry(reader, i);
	return 0;
}

int schedule_read(const char *path, struct schedule *ret, struct why *why)
{
	struct schedule schedule = { 0 };
	struct step step = { 0 };
	struct trace_reader *reader;
	struct trace_event event;
	int r;

	r = trace_reader_open_path(path, &reader, why);
	if (r < 0)
		return r;
	schedule.header = *trace_reader_header(reader);
	while ((r = trace_reader_next(reader, &event, why)) > 0) {
		r = take(&schedule, &step, &event);
		if (r < 0) {
			(void)why_errno(why, r, "a trace");
			break;
		}
	}
	if (r < 0)
		why_prefix(why, "%s", path);
	if (r == 0) {
		r = end_step(&schedule, &step);
		if (r == 0)
			r = keep_entries(&schedule, reader);
		if (r < 0)
			(void)why_errno(why, r, "%s", path);
	}
	trace_reader_close(reader);
	free(step.wants);
	free(step.wanted_at);
	if (r < 0) {
		schedule_done(&schedule);
		return r;
	}
	*ret = schedule;
	return 0;
}

void schedule_done(struct schedule *schedule)
{
	free(schedule->entries);
	free(schedule->ops);
	memset(schedule, 0, sizeof(*schedule));
}
