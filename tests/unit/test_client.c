/* SPDX-License-Identifier: MIT */
/*
 * The client library against a daemon that does what each test says: sets, what makes a node
 * drawable, what is given back, loss and return.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "tests/helper.h"
#include "tests/unit/fake_daemon.h"

/* The daemon takes a set over: holds granted and payloads ready. */
static void serve(struct fake_scene *scene, uint64_t serial, uint32_t first, uint32_t count)
{
	for (uint32_t i = 0; i < count; i++) {
		fake_grant(scene->fake, 0, first + i, true);
		fake_ready(scene->fake, 0, first + i, 0, i);
	}
	fake_settle(scene->fake, serial);
}

static bool is_payload(const struct fake_scene *scene, uint32_t node)
{
	const uint8_t *bytes = ooc_map(scene->store, node);

	for (uint32_t i = 0; bytes && i < FAKE_PAYLOAD_BYTES; i++)
		assert_int_equal(bytes[i], (uint8_t)node);
	return bytes != NULL;
}

/* ---- sets ---- */

static void a_set_equal_to_the_one_before_sends_nothing(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_counters before;
	struct ooc_counters after;
	int64_t serial = fake_give(scene, 1, 3);
	const struct wire_set *set = fake_expect_set(scene->fake, (uint64_t)serial);

	assert_int_equal(set->entry_count, 3);
	assert_int_equal(set->entries[0].node, 1);
	assert_int_equal(set->flags, WIRE_SET_FIRST | WIRE_SET_LAST | WIRE_SET_RETIRE);
	fake_acknowledge(scene->fake, (uint64_t)serial);

	ooc_counters(scene->client, &before);
	for (int i = 0; i < 10; i++)
		assert_int_equal(fake_give(scene, 1, 3), serial);
	ooc_counters(scene->client, &after);
	assert_int_equal(after.messages_sent, before.messages_sent);
	fake_expect_nothing(scene->fake);

	assert_true(fake_give(scene, 1, 4) > serial);
	(void)fake_expect_set(scene->fake, 0);
}

/* Sanitizers make calls of their own. */
#ifndef OOCD_SANITIZED

/* From here on any system call but the last ends the process.  (Not everywhere is the clock without.) */
static int forbid_calls(void)
{
	struct sock_filter filter[] = {
		BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
		BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_exit_group, 2, 0),
		BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_clock_gettime, 1, 0),
		BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
		BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
	};
	struct sock_fprog program = { sizeof(filter) / sizeof(filter[0]), filter };

	if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) < 0)
		return -1;
	return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
}

static _Noreturn void draw_without_calls(struct fake_scene *scene, int64_t serial)
{
	struct wire_session_page *page = scene->fake->page.base;

	if (forbid_calls() < 0)
		_exit(1);
	for (unsigned i = 0; i < 1000; i++) {
		/* The daemon's sign of life: without it the socket would be looked at. */
		atomic_fetch_add_explicit(&page->beat, 1, memory_order_relaxed);
		if (ooc_dispatch(scene->client) < 0 || fake_give(scene, 1, 3) != serial ||
		    !ooc_map(scene->store, 1))
			_exit(1);
	}
	_exit(0);
}

static void where_nothing_has_changed_no_system_call_is_made(void **state)
{
	struct fake_scene *scene = *state;
	int64_t serial = fake_give(scene, 1, 3);
	pid_t pid;

	(void)fake_expect_set(scene->fake, (uint64_t)serial);
	serve(scene, (uint64_t)serial, 1, 3);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	pid = test_fork();
	if (pid == 0)
		draw_without_calls(scene, serial);
	assert_int_equal(test_wait(pid), 0);
}

#endif

static void while_a_set_is_unanswered_the_newest_waits_and_those_between_are_never_sent(
	void **state)
{
	struct fake_scene *scene = *state;
	int64_t first = fake_give(scene, 1, 1);
	int64_t newest = 0;

	(void)fake_expect_set(scene->fake, (uint64_t)first);
	for (uint32_t i = 2; i < 6; i++)
		newest = fake_give(scene, i, 1);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	fake_expect_nothing(scene->fake);

	fake_acknowledge(scene->fake, (uint64_t)first);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_int_equal(fake_expect_set(scene->fake, (uint64_t)newest)->entries[0].node, 5);
	fake_expect_nothing(scene->fake);
}

static void a_large_set_spans_messages(void **state)
{
	struct fake_scene *scene = *state;
	uint32_t count = 2 * WIRE_SET_ENTRY_COUNT_MAX + 1;
	int64_t serial = fake_give(scene, 1, count);
	uint32_t seen = 0;

	while (seen < count) {
		const struct wire_set *set = fake_expect(scene->fake, WIRE_SET);

		assert_int_equal(set->serial, serial);
		assert_int_equal((set->flags & WIRE_SET_FIRST) != 0, seen == 0);
		assert_int_equal(set->entries[0].node, 1 + seen);
		seen += set->entry_count;
		assert_int_equal((set->flags & WIRE_SET_LAST) != 0, seen == count);
	}
	assert_int_equal(seen, count);
	fake_expect_nothing(scene->fake);
}

static void an_empty_set_is_said(void **state)
{
	struct fake_scene *scene = *state;

	assert_true(fake_give(scene, 1, 0) > 0);
	assert_int_equal(fake_expect_set(scene->fake, 0)->entry_count, 0);
}

static void a_node_given_twice_counts_once(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_want wants[] = { { scene->store, 7, 2 },
				    { scene->store, 8, 1 },
				    { scene->store, 7, 0 } };

	assert_true(ooc_visible_set(scene->client, wants, 3) > 0);
	assert_int_equal(fake_expect_set(scene->fake, 0)->entry_count, 2);
}

static void wants_that_cannot_be_are_refused_and_the_set_before_stays(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_client *client = scene->client;
	struct ooc_want no_payload = { scene->store, 0, 1 };
	struct ooc_want no_node = { scene->store, FAKE_NODE_COUNT, 1 };
	struct ooc_want no_store = { NULL, 1, 1 };
	struct ooc_want no_number = { scene->store, 1, NAN };
	struct ooc_want negative = { scene->store, 1, -1 };
	struct ooc_want ascending[] = { { scene->store, 1, 1 }, { scene->store, 2, 2 } };
	struct ooc_progress progress;
	int64_t serial = fake_give(scene, 1, 3);

	(void)fake_expect_set(scene->fake, (uint64_t)serial);
	fake_acknowledge(scene->fake, (uint64_t)serial);
	assert_int_equal(ooc_visible_set(client, &no_payload, 1), -EINVAL);
	assert_non_null(strstr(ooc_error_text(client), "nothing to draw"));
	assert_int_equal(ooc_visible_set(client, &no_node, 1), -EINVAL);
	assert_int_equal(ooc_visible_set(client, &no_store, 1), -EINVAL);
	assert_int_equal(ooc_visible_set(client, &no_number, 1), -EINVAL);
	assert_int_equal(ooc_visible_set(client, &negative, 1), -EINVAL);
	assert_int_equal(ooc_visible_set(client, ascending, 2), -EINVAL);
	assert_int_equal(ooc_visible_set(client, ascending, (1u << 20) + 1), -E2BIG);
	assert_int_equal(ooc_prefetch(client, &no_payload, 1), -EINVAL);
	fake_expect_nothing(scene->fake);
	ooc_progress(client, &progress);
	assert_int_equal(progress.serial, serial);
	assert_int_equal(progress.want_count, 3);
}

static void a_full_socket_delays_a_set_and_loses_none_of_it(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_want want = { scene->store, 1, 1 };
	unsigned prefetch_count = 0;
	int64_t serial;
	int r;

	while ((r = ooc_prefetch(scene->client, &want, 1)) == 0)
		prefetch_count++;
	assert_int_equal(r, -EAGAIN);
	serial = fake_give(scene, 1, 3 * WIRE_SET_ENTRY_COUNT_MAX);
	assert_true(serial > 0);
	while (prefetch_count-- > 0)
		(void)fake_expect(scene->fake, WIRE_PREFETCH);
	fake_expect_nothing(scene->fake);

	for (unsigned i = 0; i < 3; i++) {
		assert_int_equal(ooc_dispatch(scene->client), 0);
		assert_int_equal(
			((const struct wire_set *)fake_expect(scene->fake, WIRE_SET))->serial,
			serial);
	}
	fake_expect_nothing(scene->fake);
}

/* ---- what is drawable ---- */

static void a_node_is_drawable_when_acknowledged_granted_ready_and_its_segment_known(void **state)
{
	struct fake_scene *scene = *state;
	struct fake_daemon *fake = scene->fake;
	int64_t serial = fake_give(scene, 5, 1);

	(void)fake_expect_set(fake, (uint64_t)serial);
	for (unsigned facts = 0; facts < 8; facts++) {
		fake_acknowledge(fake, (facts & 1) ? (uint64_t)serial : 0);
		fake_grant(fake, 0, 5, (facts & 2) != 0);
		if (facts & 4)
			fake_ready(fake, 0, 5, 0, 3);
		else
			fake_word(fake, 0, 5, wire_word(WIRE_NODE_BUSY, 0, 3, 0));
		assert_int_equal(is_payload(scene, 5), facts == 7);
	}
	/* A segment that was announced and not read of yet, and one that never was. */
	fake_segment(fake, 0, 1);
	fake_ready(fake, 0, 5, 1, 2);
	assert_false(is_payload(scene, 5));
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_true(is_payload(scene, 5));
	fake_word(fake, 0, 5, wire_word(WIRE_NODE_READY, 2, 0, 9));
	assert_false(is_payload(scene, 5));
	/* The last page has room for the payload; what lies after it has not. */
	fake_ready(fake, 0, 5, 0, FAKE_SEGMENT_BYTES / WIRE_PAGE_BYTES - 1);
	assert_true(is_payload(scene, 5));
	fake_word(fake, 0, 5,
		  wire_word(WIRE_NODE_READY, 0, FAKE_SEGMENT_BYTES / WIRE_PAGE_BYTES, 9));
	assert_false(is_payload(scene, 5));
	assert_null(ooc_map(scene->store, 6));
	assert_null(ooc_map(scene->store, FAKE_NODE_COUNT));
}

static void a_node_dropped_and_wanted_again_waits_for_the_later_set(void **state)
{
	struct fake_scene *scene = *state;
	struct fake_daemon *fake = scene->fake;
	int64_t serial = fake_give(scene, 1, 2);
	int64_t without;
	int64_t again;

	(void)fake_expect_set(fake, (uint64_t)serial);
	serve(scene, (uint64_t)serial, 1, 2);
	assert_true(is_payload(scene, 1));

	without = fake_give(scene, 2, 1);
	(void)fake_expect_set(fake, (uint64_t)without);
	assert_false(is_payload(scene, 1));
	assert_true(is_payload(scene, 2));
	fake_acknowledge(fake, (uint64_t)without);

	/* The grant bit still stands from before, and the word says READY: neither is to be believed. */
	again = fake_give(scene, 1, 2);
	(void)fake_expect_set(fake, (uint64_t)again);
	assert_false(is_payload(scene, 1));
	assert_true(is_payload(scene, 2));
	fake_acknowledge(fake, (uint64_t)again);
	assert_true(is_payload(scene, 1));
}

static void a_drop_that_was_never_sent_costs_nothing(void **state)
{
	struct fake_scene *scene = *state;
	int64_t serial = fake_give(scene, 1, 2);

	(void)fake_expect_set(scene->fake, (uint64_t)serial);
	serve(scene, (uint64_t)serial, 1, 2);
	serial = fake_give(scene, 1, 3);
	(void)fake_expect_set(scene->fake, (uint64_t)serial);
	/* That one is unanswered, so the next two wait, and the second replaces the first. */
	(void)fake_give(scene, 2, 1);
	assert_false(is_payload(scene, 1));
	serial = fake_give(scene, 1, 2);
	assert_true(is_payload(scene, 1));
	fake_expect_nothing(scene->fake);
}

static void a_place_is_valid_until_the_node_is_filled_anew_or_thrown_out(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_place place;
	struct ooc_place other;
	const void *base;
	uint64_t bytes;
	uint64_t unique;
	int64_t serial = fake_give(scene, 3, 1);

	(void)fake_expect_set(scene->fake, (uint64_t)serial);
	assert_int_equal(ooc_locate(scene->store, 3, &place), -EAGAIN);
	serve(scene, (uint64_t)serial, 3, 1);
	assert_int_equal(ooc_locate(scene->store, 3, &place), 0);
	assert_int_equal(ooc_segment(scene->store, place.segment, &base, &bytes, &unique), 0);
	assert_ptr_equal((const uint8_t *)base + place.offset_bytes, ooc_map(scene->store, 3));
	assert_int_equal(bytes, FAKE_SEGMENT_BYTES);
	assert_int_equal(ooc_segment(scene->store, 5000, &base, &bytes, &unique), -ENOENT);
	assert_true(ooc_still_valid(scene->store, 3, &place));

	fake_word(scene->fake, 0, 3, 0);
	assert_false(ooc_still_valid(scene->store, 3, &place));
	fake_ready(scene->fake, 0, 3, 0, 0);
	assert_int_equal(ooc_locate(scene->store, 3, &other), 0);
	fake_word(scene->fake, 0, 3, wire_word(WIRE_NODE_READY, 0, 0, 7));
	assert_false(ooc_still_valid(scene->store, 3, &other));
}

static void a_segment_that_goes_is_unmapped(void **state)
{
	struct fake_scene *scene = *state;
	const void *base;
	uint64_t bytes;
	uint64_t unique;
	uint64_t unique_next;

	assert_int_equal(ooc_segment(scene->store, 0, &base, &bytes, &unique), 0);
	fake_segment_gone(scene->fake, 0, 0);
	fake_segment_gone(scene->fake, 0, 3);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_int_equal(ooc_segment(scene->store, 0, &base, &bytes, &unique), -ENOENT);
	fake_segment(scene->fake, 0, 17);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_int_equal(ooc_segment(scene->store, 0, &base, &bytes, &unique_next), 0);
	assert_int_not_equal(unique, unique_next);
}

/* ---- what is given back ---- */

static void what_is_kept_for_drawing_is_given_back_by_retire(void **state)
{
	struct fake_scene *scene = *state;
	struct fake_daemon *fake = scene->fake;
	const struct wire_retire *retire;
	int64_t serials[3];

	ooc_keep_drawing(scene->client, true);
	for (uint32_t i = 0; i < 3; i++) {
		serials[i] = fake_give(scene, 1 + i, 1);
		assert_int_equal(fake_expect_set(fake, (uint64_t)serials[i])->flags,
				 WIRE_SET_FIRST | WIRE_SET_LAST);
		fake_acknowledge(fake, (uint64_t)serials[i]);
	}
	assert_int_equal(ooc_retire(scene->client, serials[1]), 0);
	retire = fake_expect(fake, WIRE_RETIRE);
	assert_int_equal(retire->serial, serials[1]);
	assert_int_equal(ooc_retire(scene->client, serials[0]), 0);
	fake_expect_nothing(fake);
	assert_int_equal(ooc_retire(scene->client, serials[2] + 1), -EINVAL);
	assert_int_equal(ooc_retire(scene->client, -1), -EINVAL);
}

static void retiring_a_set_that_was_never_sent_keeps_what_it_could_draw(void **state)
{
	struct fake_scene *scene = *state;
	struct fake_daemon *fake = scene->fake;
	const struct wire_set *set;
	int64_t sent;
	int64_t replaced;
	int64_t last;

	ooc_keep_drawing(scene->client, true);
	sent = fake_give(scene, 1, 2);
	(void)fake_expect_set(fake, (uint64_t)sent);
	replaced = fake_give(scene, 1, 1);
	last = fake_give(scene, 3, 1);
	/* Under `replaced` node 1 may be drawn, which is held by `sent` alone. */
	assert_int_equal(ooc_retire(scene->client, replaced), 0);
	assert_int_equal(((const struct wire_retire *)fake_expect(fake, WIRE_RETIRE))->serial,
			 sent);
	fake_acknowledge(fake, (uint64_t)sent);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	set = fake_expect_set(fake, (uint64_t)last);
	assert_false(set->flags & WIRE_SET_RETIRE);
	assert_int_equal(ooc_retire(scene->client, last), 0);
	assert_int_equal(((const struct wire_retire *)fake_expect(fake, WIRE_RETIRE))->serial,
			 last);
}

static void recall(struct fake_scene *scene)
{
	struct wire_recall message = { .serial = 1 };

	fake_send(scene->fake, &message, WIRE_RECALL, sizeof(message), NULL, 0);
	assert_int_equal(ooc_dispatch(scene->client), 0);
}

static uint64_t retired(struct fake_scene *scene)
{
	return ((const struct wire_retire *)fake_expect(scene->fake, WIRE_RETIRE))->serial;
}

static void asked_to_let_go_nothing_that_was_looked_at_is_drawn_any_more(void **state)
{
	struct fake_scene *scene = *state;
	int64_t serial = fake_give(scene, 1, 3);

	(void)fake_expect_set(scene->fake, (uint64_t)serial);
	fake_acknowledge(scene->fake, (uint64_t)serial);
	for (uint32_t i = 0; i < 2; i++) {
		recall(scene);
		assert_int_equal(retired(scene), serial + 1);
	}
	/* The set stays what it was, and the next one is not retired by that. */
	assert_int_equal(fake_give(scene, 1, 3), serial);
	fake_expect_nothing(scene->fake);
	serial = fake_give(scene, 1, 4);
	(void)fake_expect_set(scene->fake, (uint64_t)serial);
	fake_acknowledge(scene->fake, (uint64_t)serial);
	recall(scene);
	assert_int_equal(retired(scene), serial + 1);
}

static void asked_to_let_go_a_program_that_keeps_drawing_retires_its_next_set(void **state)
{
	struct fake_scene *scene = *state;
	int64_t serial;
	int64_t next;

	ooc_keep_drawing(scene->client, true);
	serial = fake_give(scene, 1, 3);
	(void)fake_expect_set(scene->fake, (uint64_t)serial);
	fake_acknowledge(scene->fake, (uint64_t)serial);
	recall(scene);
	assert_int_equal(retired(scene), 0);
	/* The same set is another one now, so that it can be told from what is drawn. */
	next = fake_give(scene, 1, 3);
	assert_true(next > serial);
	assert_int_equal(fake_expect_set(scene->fake, (uint64_t)next)->flags,
			 WIRE_SET_FIRST | WIRE_SET_LAST);
	fake_acknowledge(scene->fake, (uint64_t)next);
	assert_int_equal(ooc_retire(scene->client, next), 0);
	assert_int_equal(retired(scene), next);
	assert_int_equal(fake_give(scene, 1, 3), next);
	fake_expect_nothing(scene->fake);
}

static void a_set_retired_before_it_is_sent_says_so_itself(void **state)
{
	struct fake_scene *scene = *state;
	int64_t sent;
	int64_t last;

	ooc_keep_drawing(scene->client, true);
	sent = fake_give(scene, 1, 2);
	(void)fake_expect_set(scene->fake, (uint64_t)sent);
	last = fake_give(scene, 3, 1);
	assert_int_equal(ooc_retire(scene->client, last), 0);
	assert_int_equal(retired(scene), sent);
	fake_acknowledge(scene->fake, (uint64_t)sent);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_true(fake_expect_set(scene->fake, (uint64_t)last)->flags & WIRE_SET_RETIRE);
}

/* ---- what is refused, and waiting ---- */

static void refusals_count_for_the_set_they_speak_of(void **state)
{
	struct fake_scene *scene = *state;
	struct fake_daemon *fake = scene->fake;
	struct ooc_progress progress;
	int64_t serial = fake_give(scene, 1, 3);

	(void)fake_expect_set(fake, (uint64_t)serial);
	serve(scene, (uint64_t)serial, 1, 2);
	ooc_progress(scene->client, &progress);
	assert_int_equal(progress.drawable_count, 2);
	assert_false(progress.settled);

	fake_refuse(fake, (uint64_t)serial, 0, 3, WIRE_REASON_FULL);
	fake_refuse(fake, (uint64_t)serial, 0, FAKE_NODE_COUNT, WIRE_REASON_FULL);
	fake_refuse(fake, (uint64_t)serial, 9, 3, WIRE_REASON_FULL);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_int_equal(ooc_not_now(scene->store, 3), OOC_REASON_FULL);
	assert_int_equal(ooc_not_now(scene->store, 1), OOC_REASON_NONE);
	assert_int_equal(ooc_not_now(scene->store, 4), OOC_REASON_NONE);
	ooc_progress(scene->client, &progress);
	assert_int_equal(progress.refused_count, 1);
	assert_true(progress.settled);
	assert_false(progress.complete);

	/* The next set is answered anew; until it is, the old answer is the best known. */
	serial = fake_give(scene, 1, 4);
	(void)fake_expect_set(fake, (uint64_t)serial);
	ooc_progress(scene->client, &progress);
	assert_int_equal(progress.refused_count, 0);
	assert_int_equal(ooc_not_now(scene->store, 3), OOC_REASON_FULL);
	serve(scene, (uint64_t)serial, 1, 2);
	assert_int_equal(ooc_not_now(scene->store, 3), OOC_REASON_NONE);
}

static void *settle_when_asked(void *arg)
{
	struct fake_scene *scene = arg;
	const struct wire_set *set = fake_expect_set(scene->fake, 0);
	uint64_t serial;

	FAKE_CHECK(!(set->flags & WIRE_SET_EVENTS));
	serial = set->serial;
	fake_acknowledge(scene->fake, serial);
	(void)fake_expect(scene->fake, WIRE_LISTEN);
	serve(scene, serial, 1, 2);
	fake_event(scene->fake, serial, true);
	return NULL;
}

static void waiting_listens_and_wakes_by_event(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_progress progress;
	int64_t serial = fake_give(scene, 1, 2);
	pthread_t thread;

	/* Nobody answers: the set is said, and that is all. */
	assert_int_equal(ooc_wait(scene->client, 0), -ETIMEDOUT);
	assert_int_equal(pthread_create(&thread, NULL, settle_when_asked, scene), 0);
	assert_int_equal(ooc_wait(scene->client, 10000), 0);
	assert_int_equal(pthread_join(thread, NULL), 0);
	ooc_progress(scene->client, &progress);
	assert_true(progress.complete);
	assert_int_equal(progress.serial, serial);
	assert_true(is_payload(scene, 1));
	assert_int_equal(fake_give(scene, 1, 2), serial);
	fake_expect_nothing(scene->fake);
}

static void a_caller_that_sleeps_does_not_wait_for_answers(void **state)
{
	struct fake_scene *scene = *state;

	ooc_notify(scene->client, true);
	for (uint32_t i = 1; i < 4; i++) {
		int64_t serial = fake_give(scene, i, 1);

		assert_int_equal(fake_expect_set(scene->fake, (uint64_t)serial)->entries[0].node,
				 i);
	}
}

static void notify_makes_the_descriptor_tell(void **state)
{
	struct fake_scene *scene = *state;
	struct pollfd readable = { .fd = ooc_fd(scene->client), .events = POLLIN };
	int64_t serial;

	ooc_notify(scene->client, true);
	fake_expect_nothing(scene->fake);
	serial = fake_give(scene, 1, 1);
	assert_true(fake_expect_set(scene->fake, (uint64_t)serial)->flags & WIRE_SET_EVENTS);
	assert_int_equal(poll(&readable, 1, 0), 0);
	serve(scene, (uint64_t)serial, 1, 1);
	fake_event(scene->fake, (uint64_t)serial, true);
	assert_int_equal(poll(&readable, 1, 10000), 1);
	assert_int_equal(ooc_dispatch(scene->client), 0);
	assert_int_equal(poll(&readable, 1, 0), 0);
}

static void *answer_status(void *arg)
{
	struct fake_daemon *fake = arg;
	static const char *const pieces[] = { "{\"a\":", "1", "}" };

	(void)fake_expect(fake, WIRE_STATUS);
	for (size_t i = 0; i < 3; i++) {
		_Alignas(8) uint8_t bytes[64] = { 0 };
		struct wire_text *text = (struct wire_text *)(void *)bytes;

		text->last = i == 2;
		text->text_bytes = (uint32_t)strlen(pieces[i]);
		memcpy(text->text, pieces[i], text->text_bytes);
		fake_send(fake, text, WIRE_TEXT, sizeof(*text) + text->text_bytes, NULL, 0);
	}
	return NULL;
}

static void status_is_put_together_from_its_pieces(void **state)
{
	struct fake_scene *scene = *state;
	pthread_t thread;
	char *text;

	for (int i = 0; i < 2; i++) {
		assert_int_equal(pthread_create(&thread, NULL, answer_status, scene->fake), 0);
		assert_int_equal(ooc_status(scene->client, &text), 0);
		assert_int_equal(pthread_join(thread, NULL), 0);
		assert_string_equal(text, "{\"a\":1}");
		free(text);
	}
}

static void *answer_orders(void *arg)
{
	struct fake_daemon *fake = arg;
	_Alignas(8) uint8_t bytes[sizeof(struct wire_nodes) + sizeof(struct wire_node)] = { 0 };
	struct wire_nodes *nodes = (struct wire_nodes *)(void *)bytes;
	struct wire_error error = { .error = -EACCES, .type = WIRE_ADMIN, .text = "not you" };
	const struct wire_admin *admin = fake_expect(fake, WIRE_ADMIN);

	assert_int_equal(admin->what, WIRE_ADMIN_EVICT);
	assert_int_equal(admin->store, WIRE_STORE_ALL);
	fake_send(fake, &error, WIRE_ERROR, sizeof(error), NULL, 0);
	(void)fake_expect(fake, WIRE_STATUS);
	nodes->first = 7;
	nodes->entry_count = 1;
	nodes->entries[0] = (struct wire_node){
		.order = 99,
		.age_ds = 15,
		.payer = 4,
		.cached = WIRE_CACHED_FREE,
		.flags = WIRE_NODE_UNUSED_PREFETCH,
	};
	fake_send(fake, nodes, WIRE_NODES, sizeof(bytes), NULL, 0);
	return NULL;
}

static void orders_are_judged_here_and_by_the_daemon(void **state)
{
	static struct ooc_node_info infos[OOC_INSPECT_COUNT_MAX];
	struct fake_scene *scene = *state;
	const uint32_t none = UINT32_MAX;
	char *text = NULL;
	pthread_t thread;

	/* What cannot be is not sent. */
	assert_int_equal(ooc_steer(scene->client, OOC_PIN, NULL, NULL, 0, &text), -EINVAL);
	assert_int_equal(ooc_steer(scene->client, OOC_EVICT, NULL, &none, 1, &text), -EINVAL);
	assert_int_equal(ooc_steer(scene->client, OOC_RELOAD, scene->store, NULL, 0, &text),
			 -EINVAL);
	assert_int_equal(ooc_steer(scene->client, OOC_PIN, scene->store, &none, 1, &text), -EINVAL);
	assert_int_equal(ooc_steer(scene->client, OOC_PIN, scene->store, &none,
				   OOC_ORDER_NODE_COUNT_MAX + 1, &text),
			 -E2BIG);
	assert_int_equal(pthread_create(&thread, NULL, answer_orders, scene->fake), 0);
	assert_int_equal(ooc_steer(scene->client, OOC_EVICT, NULL, NULL, 0, &text), -EACCES);
	assert_string_equal(ooc_error_text(scene->client), "not you");
	assert_null(text);
	assert_int_equal(ooc_inspect(scene->store, 7, infos), 1);
	assert_int_equal(pthread_join(thread, NULL), 0);
	assert_int_equal(infos[0].state, OOC_STATE_READY);
	assert_true(infos[0].replaced == 99 && infos[0].payer == 4 && infos[0].holds == 0);
	assert_true(infos[0].age_s == 1.5 && infos[0].unused_prefetch && !infos[0].pinned);
}

/* ---- stores ---- */

static void a_closed_store_leaves_the_set(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_store *second = fake_open(scene->fake, scene->client);
	struct ooc_want wants[] = { { scene->store, 1, 2 }, { second, 2, 1 } };
	struct ooc_progress progress;

	assert_true(ooc_visible_set(scene->client, wants, 2) > 0);
	(void)fake_expect_set(scene->fake, 0);
	ooc_close(second);
	assert_int_equal(((const struct wire_close *)fake_expect(scene->fake, WIRE_CLOSE))->store,
			 1);
	ooc_progress(scene->client, &progress);
	assert_int_equal(progress.want_count, 1);
	/* What the daemon still says of it does no harm. */
	fake_segment(scene->fake, 1, 1);
	fake_segment_gone(scene->fake, 1, 1);
	fake_refuse(scene->fake, 1, 1, 2, WIRE_REASON_FULL);
	assert_int_equal(ooc_dispatch(scene->client), 0);
}

static void a_file_that_is_no_store_is_refused_before_anything_is_sent(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_store *store;

	assert_int_equal(ooc_open(scene->client, "/nonexistent/x.ooc", &store), -ENOENT);
	assert_int_equal(ooc_open(scene->client, scene->folder, &store), -EUCLEAN);
	assert_int_equal(ooc_open(scene->client, scene->fake->path, &store), -ENXIO);
	fake_expect_nothing(scene->fake);
}

static void *refuse_open(void *arg)
{
	struct fake_daemon *fake = arg;
	struct wire_error error = {
		.error = -EUCLEAN,
		.type = WIRE_OPEN,
		.version = WIRE_VERSION,
		.text = "no superblock is whole",
	};

	error.store = ((const struct wire_open *)fake_expect(fake, WIRE_OPEN))->store;
	fake_send(fake, &error, WIRE_ERROR, sizeof(error), NULL, 0);
	return NULL;
}

static void the_daemons_reason_for_not_opening_is_passed_on(void **state)
{
	struct fake_scene *scene = *state;
	struct ooc_store *store;
	pthread_t thread;

	assert_int_equal(pthread_create(&thread, NULL, refuse_open, scene->fake), 0);
	assert_int_equal(ooc_open(scene->client, scene->fake->store_path, &store), -EUCLEAN);
	assert_int_equal(pthread_join(thread, NULL), 0);
	assert_string_equal(ooc_error_text(scene->client), "no superblock is whole");
	assert_int_equal(ooc_dispatch(scene->client), 0);
	/* Its number is free again. */
	store = fake_open(scene->fake, scene->client);
	ooc_close(store);
	assert_int_equal(((const struct wire_close *)fake_expect(scene->fake, WIRE_CLOSE))->store,
			 1);
}

#define SCENE_TEST(test)                                                                           \
	cmocka_unit_test_setup_teardown(test, fake_scene_setup, fake_scene_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		SCENE_TEST(a_set_equal_to_the_one_before_sends_nothing),
#ifndef OOCD_SANITIZED
		SCENE_TEST(where_nothing_has_changed_no_system_call_is_made),
#endif
		SCENE_TEST(
			while_a_set_is_unanswered_the_newest_waits_and_those_between_are_never_sent),
		SCENE_TEST(a_large_set_spans_messages),
		SCENE_TEST(an_empty_set_is_said),
		SCENE_TEST(a_node_given_twice_counts_once),
		SCENE_TEST(wants_that_cannot_be_are_refused_and_the_set_before_stays),
		SCENE_TEST(a_full_socket_delays_a_set_and_loses_none_of_it),
		SCENE_TEST(
			a_node_is_drawable_when_acknowledged_granted_ready_and_its_segment_known),
		SCENE_TEST(a_node_dropped_and_wanted_again_waits_for_the_later_set),
		SCENE_TEST(a_drop_that_was_never_sent_costs_nothing),
		SCENE_TEST(a_place_is_valid_until_the_node_is_filled_anew_or_thrown_out),
		SCENE_TEST(a_segment_that_goes_is_unmapped),
		SCENE_TEST(what_is_kept_for_drawing_is_given_back_by_retire),
		SCENE_TEST(retiring_a_set_that_was_never_sent_keeps_what_it_could_draw),
		SCENE_TEST(a_set_retired_before_it_is_sent_says_so_itself),
		SCENE_TEST(asked_to_let_go_nothing_that_was_looked_at_is_drawn_any_more),
		SCENE_TEST(asked_to_let_go_a_program_that_keeps_drawing_retires_its_next_set),
		SCENE_TEST(refusals_count_for_the_set_they_speak_of),
		SCENE_TEST(waiting_listens_and_wakes_by_event),
		SCENE_TEST(a_caller_that_sleeps_does_not_wait_for_answers),
		SCENE_TEST(notify_makes_the_descriptor_tell),
		SCENE_TEST(status_is_put_together_from_its_pieces),
		SCENE_TEST(orders_are_judged_here_and_by_the_daemon),
		SCENE_TEST(a_closed_store_leaves_the_set),
		SCENE_TEST(a_file_that_is_no_store_is_refused_before_anything_is_sent),
		SCENE_TEST(the_daemons_reason_for_not_opening_is_passed_on),
	};

	return TEST_RUN(tests);
}
