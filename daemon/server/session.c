/* SPDX-License-Identifier: MIT */
#include "daemon/server/session.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cache/recorder.h"
#include "daemon/limits.h"
#include "daemon/server/inspect.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/log.h"

/* Refusals that fit into one message. */
#define REFUSALS_MAX 4096u

static_assert(sizeof(struct wire_not_now) + REFUSALS_MAX * sizeof(struct wire_refusal) <=
		      WIRE_MESSAGE_BYTES_MAX,
	      "a message holds that many refusals");

/* ---- answers ---- */

static int send_message(struct session *session, const void *message, size_t message_bytes,
			const int *fds, size_t fd_count)
{
	session->account->sent_bytes += message_bytes;
	return connection_send(session->connection, message, message_bytes, fds, fd_count);
}

static void send_error(struct session *session, int error, uint16_t type, uint32_t slot,
		       const struct why *why)
{
	struct wire_error message = {
		.error = error,
		.type = type,
		.store = slot,
		.version = WIRE_VERSION,
	};

	wire_header_init(&message.header, WIRE_ERROR, sizeof(message));
	/* Not copied whole: what lies behind a reason's end is nobody's business. */
	(void)snprintf(message.text, sizeof(message.text), "%s", why->text);
	(void)send_message(session, &message, sizeof(message), NULL, 0);
}

/* The client broke a rule: it is told which, and dropped. */
static void reject(struct session *session, uint16_t type, int error, const char *text)
{
	struct why why;

	(void)why_set(&why, error, "%s", text);
	send_error(session, error, type, 0, &why);
	connection_break(session->connection, error, text);
}

static void send_segment(struct session *session, uint32_t slot, const struct segment *segment)
{
	struct wire_segment message = {
		.store = slot,
		.segment = segment->number,
		.segment_bytes = segment->memfile.bytes,
	};

	wire_header_init(&message.header, WIRE_SEGMENT, sizeof(message));
	(void)send_message(session, &message, sizeof(message), &segment->memfile.read_fd, 1);
}

static void send_opened(struct session *session, uint32_t slot)
{
	const struct attachment *attachment = session->visible.attachments[slot];
	const struct served *served = attachment->served;
	int fds[] = { served->hs.read_fd, served->directory_file.read_fd,
		      attachment->grants_file.read_fd };
	struct wire_opened message = {
		.store = slot,
		.segment_bytes_log2 = (uint32_t)__builtin_ctzll(served->arena.segment_bytes),
		.generation = served->superblock->generation,
		.node_count = served->node_count,
		.hs_bytes = sizeof(struct store_superblock) +
			    (uint64_t)served->node_count * sizeof(struct store_node),
		.directory_bytes = sizeof(struct wire_directory) +
				   (uint64_t)served->node_count * sizeof(uint64_t),
		.grants_bytes = sizeof(struct wire_grants) +
				((uint64_t)served->node_count + 63) / 64 * sizeof(uint64_t),
	};

	wire_header_init(&message.header, WIRE_OPENED, sizeof(message));
	memcpy(message.uuid, served->superblock->uuid, sizeof(message.uuid));
	(void)send_message(session, &message, sizeof(message), fds, ARRAY_LENGTH(fds));
	LIST_FOR_EACH (link, &served->arena.in_order)
		send_segment(session, slot, ARENA_SEGMENT(link));
}

void session_opened(struct session *session, uint32_t slot, uint32_t ticket, struct served *served)
{
	struct why why;
	int r;

	if (session->tickets[slot] != ticket)
		return;
	r = visible_attach(&session->visible, slot, served, session->epoch, &why);
	if (r < 0) {
		session_refuse(session, slot, ticket, r, &why);
		return;
	}
	session->tickets[slot] = 0;
	send_opened(session, slot);
}

void session_refuse(struct session *session, uint32_t slot, uint32_t ticket, int error,
		    const struct why *why)
{
	if (session->tickets[slot] != ticket)
		return;
	session->tickets[slot] = 0;
	send_error(session, error, WIRE_OPEN, slot, why);
}

void session_tell_segment(struct session *session, const struct served *served,
			  const struct segment *segment)
{
	for (uint64_t slots = session->visible.attached; slots != 0; slots &= slots - 1) {
		uint32_t slot = (uint32_t)__builtin_ctzll(slots);

		if (session->visible.attachments[slot]->served == served)
			send_segment(session, slot, segment);
	}
}

void session_tell_segment_gone(struct session *session, const struct served *served,
			       uint32_t number)
{
	struct wire_segment_gone message = { .segment = number };

	wire_header_init(&message.header, WIRE_SEGMENT_GONE, sizeof(message));
	for (uint64_t slots = session->visible.attached; slots != 0; slots &= slots - 1) {
		message.store = (uint32_t)__builtin_ctzll(slots);
		if (session->visible.attachments[message.store]->served == served)
			(void)send_message(session, &message, sizeof(message), NULL, 0);
	}
}

/* ---- what is owed ---- */

static bool is_event_owed(const struct session *session)
{
	const struct visible *visible = &session->visible;

	return session->events && visible->changed &&
	       (session->event_at_ns == 0 || visible->settled > session->event_settled ||
		visible->complete > session->event_complete);
}

static bool is_owed(const struct session *session)
{
	return visible_owes_refusals(&session->visible) || session->recall_owed ||
	       session->question != 0 || is_event_owed(session);
}

static void send_refusals(struct session *session)
{
	_Alignas(8) uint8_t
		bytes[sizeof(struct wire_not_now) + REFUSALS_MAX * sizeof(struct wire_refusal)];
	struct wire_not_now *message = (struct wire_not_now *)(void *)bytes;
	uint32_t count = visible_take_refusals(&session->visible, message->entries, REFUSALS_MAX);

	message->serial = session->visible.serial;
	message->entry_count = count;
	message->reserved = 0;
	wire_header_init(&message->header, WIRE_NOT_NOW,
			 sizeof(*message) + count * sizeof(message->entries[0]));
	(void)send_message(session, message, message->header.bytes, NULL, 0);
}

static void send_text(struct session *session)
{
	_Alignas(8) uint8_t bytes[WIRE_MESSAGE_BYTES_MAX / 2];
	struct wire_text *message = (struct wire_text *)(void *)bytes;
	size_t piece_bytes =
		u64_min(session->text_bytes - session->text_sent, sizeof(bytes) - sizeof(*message));

	memcpy(message->text, session->text + session->text_sent, piece_bytes);
	session->text_sent += piece_bytes;
	message->last = session->text_sent == session->text_bytes;
	message->text_bytes = (uint32_t)piece_bytes;
	wire_header_init(&message->header, WIRE_TEXT, sizeof(*message) + piece_bytes);
	(void)send_message(session, message, message->header.bytes, NULL, 0);
	if (message->last) {
		free(session->text);
		session->text = NULL;
		session->question = 0;
	}
}

static void send_nodes(struct session *session)
{
	_Alignas(8) uint8_t bytes[sizeof(struct wire_nodes) +
				  WIRE_NODES_ENTRY_COUNT_MAX * sizeof(struct wire_node)];
	struct wire_nodes *message = (struct wire_nodes *)(void *)bytes;
	const struct attachment *attachment = session->visible.attachments[session->nodes_store];
	struct why why;

	session->question = 0;
	if (!attachment) {
		(void)why_set(&why, -ENOENT, "the store is not open in this session");
		send_error(session, -ENOENT, WIRE_STATUS, session->nodes_store, &why);
		return;
	}
	*message = (struct wire_nodes){
		.store = session->nodes_store,
		.first = session->nodes_first,
		.entry_count =
			inspect_nodes(attachment->served, session->nodes_first, message->entries),
	};
	wire_header_init(&message->header, WIRE_NODES,
			 sizeof(*message) + message->entry_count * sizeof(message->entries[0]));
	(void)send_message(session, message, message->header.bytes, NULL, 0);
}

static void send_recall(struct session *session)
{
	struct wire_recall message = { .serial = session->visible.serial };

	wire_header_init(&message.header, WIRE_RECALL, sizeof(message));
	session->recall_owed = false;
	(void)send_message(session, &message, sizeof(message), NULL, 0);
}

static void send_event(struct session *session)
{
	const struct visible *visible = &session->visible;
	struct wire_event message = {
		.serial = visible->serial,
		.settled = visible->settled == visible->serial,
		.complete = visible->complete == visible->serial,
		.missing_count = visible_missing_count(visible),
	};

	wire_header_init(&message.header, WIRE_EVENT, sizeof(message));
	session->visible.changed = false;
	session->event_settled = visible->settled;
	session->event_complete = visible->complete;
	session->event_at_ns = UINT64_MAX;
	(void)send_message(session, &message, sizeof(message), NULL, 0);
}

/* Refusals go before what settles the set, so that whoever sees it settled can know why. */
static void pump(struct session *session)
{
	while (is_owed(session)) {
		if (!connection_can_send(session->connection)) {
			connection_want_send(session->connection);
			if (session->owed_since_ns == 0)
				session->owed_since_ns = clock_now_ns();
			return;
		}
		session->owed_since_ns = 0;
		if (visible_owes_refusals(&session->visible)) {
			send_refusals(session);
			visible_settle(&session->visible);
		} else if (session->recall_owed) {
			send_recall(session);
		} else if (is_event_owed(session)) {
			send_event(session);
		} else if (session->text) {
			send_text(session);
		} else {
			send_nodes(session);
		}
	}
}

/* ---- messages ---- */

static void on_hello(struct session *session, const struct wire_hello *hello)
{
	struct wire_welcome message = {
		.version = WIRE_VERSION,
		.session = session->number,
		.epoch = session->epoch,
		.page_bytes = sizeof(struct wire_session_page),
	};

	if (hello->version != WIRE_VERSION) {
		reject(session, WIRE_HELLO, -EPROTONOSUPPORT,
		       "another version of the protocol: use programs and oocd of one release");
		return;
	}
	memcpy(session->name, hello->name, sizeof(session->name));
	session->state = SESSION_READY;
	wire_header_init(&message.header, WIRE_WELCOME, sizeof(message));
	(void)send_message(session, &message, sizeof(message), &session->page_file.read_fd, 1);
}

static void on_open(struct session *session, const struct wire_open *open, int fd)
{
	if (open->store >= WIRE_STORE_COUNT_MAX || session->tickets[open->store] != 0 ||
	    session->visible.attachments[open->store]) {
		(void)fd_close(fd);
		reject(session, WIRE_OPEN, -EPROTO, "OPEN of a number that is in use or too high");
		return;
	}
	if (++session->next_ticket == 0)
		session->next_ticket = 1;
	session->tickets[open->store] = session->next_ticket;
	session->calls->open(session->calls_arg, session, open->store, session->next_ticket, fd,
			     open->path);
}

static void on_close(struct session *session, const struct wire_close *close)
{
	if (close->store >= WIRE_STORE_COUNT_MAX) {
		reject(session, WIRE_CLOSE, -EPROTO, "CLOSE of a number that is too high");
		return;
	}
	session->tickets[close->store] = 0;
	if (!session->visible.attachments[close->store])
		return;
	visible_detach(&session->visible, close->store);
	/* Its queued prefetches may name the store. */
	session->prefetch_count = 0;
	session->prefetch_next = 0;
	session->calls->active(session->calls_arg);
}

static int incoming_add(struct session *session, const struct wire_set *set)
{
	uint32_t count = session->incoming_count + set->entry_count;

	if (count > WIRE_SET_NODE_COUNT_MAX)
		return -E2BIG;
	if (count > session->incoming_capacity) {
		uint32_t capacity = count + count / 2;
		struct wire_entry *incoming =
			realloc(session->incoming, capacity * sizeof(*incoming));

		if (!incoming)
			return -ENOMEM;
		session->incoming = incoming;
		session->incoming_capacity = capacity;
	}
	if (set->entry_count > 0)
		memcpy(&session->incoming[session->incoming_count], set->entries,
		       set->entry_count * sizeof(set->entries[0]));
	session->incoming_count = count;
	return 0;
}

/* With a new list or a new set a client may have so much prefetched again. */
static void frame_begin(struct session *session)
{
	uint64_t policy_bytes = session->account->policy.prefetch_bytes_max;

	session->prefetch_bytes = session->room->cache->budget_bytes / PREFETCH_SHARE;
	if (policy_bytes > 0)
		session->prefetch_bytes = u64_min(session->prefetch_bytes, policy_bytes);
	session->prefetch_left = PREFETCH_COUNT_MAX;
	if (session->prefetch_next < session->prefetch_count)
		queues_add_prefetch(session->queues, &session->queue_entry);
}

static void on_set(struct session *session, const struct wire_set *set)
{
	int r;

	if (set->flags & WIRE_SET_FIRST) {
		if (set->serial <= session->visible.serial) {
			reject(session, WIRE_SET, -EPROTO, "SET with a serial that does not grow");
			return;
		}
		session->incoming_serial = set->serial;
		session->incoming_count = 0;
	} else if (set->serial != session->incoming_serial) {
		reject(session, WIRE_SET, -EPROTO, "SET that goes on without having begun");
		return;
	}
	r = incoming_add(session, set);
	if (r < 0) {
		reject(session, WIRE_SET, r, "SET with more nodes than a set may have");
		return;
	}
	if (!(set->flags & WIRE_SET_LAST))
		return;
	session->incoming_serial = 0;
	session->events = set->flags & WIRE_SET_EVENTS;
	r = visible_take(&session->visible, session->incoming, session->incoming_count, set->serial,
			 set->flags & WIRE_SET_RETIRE);
	if (r < 0) {
		reject(session, WIRE_SET, r,
		       r == -ENOMEM ? "no memory for its set"
				    : "SET of a node or a store that there is not");
		return;
	}
	queues_add_fetch(session->queues, &session->queue_entry);
	frame_begin(session);
	session->calls->active(session->calls_arg);
}

static void on_prefetch(struct session *session, const struct wire_prefetch *prefetch)
{
	const struct visible *visible = &session->visible;

	for (uint32_t i = 0; i < prefetch->entry_count; i++) {
		const struct wire_entry *entry = &prefetch->entries[i];

		if (entry->store >= WIRE_STORE_COUNT_MAX || !visible->attachments[entry->store] ||
		    !served_has_payload(visible->attachments[entry->store]->served, entry->node)) {
			reject(session, WIRE_PREFETCH, -EPROTO,
			       "PREFETCH of a node or a store that there is not");
			return;
		}
	}
	if (!session->prefetch) {
		session->prefetch = calloc(WIRE_SET_ENTRY_COUNT_MAX, sizeof(*session->prefetch));
		/* A prefetch is a wish: without memory it is not heard. */
		if (!session->prefetch)
			return;
	}
	session->prefetch_count =
		(uint32_t)u64_min(prefetch->entry_count, WIRE_SET_ENTRY_COUNT_MAX);
	memcpy(session->prefetch, prefetch->entries,
	       session->prefetch_count * sizeof(*session->prefetch));
	session->prefetch_next = 0;
	session->account->prefetch_count += session->prefetch_count;
	frame_begin(session);
	session->calls->active(session->calls_arg);
}

/* An answer that has not gone yet is not added to: it would be memory for one who does not read. */
static bool may_ask(struct session *session, uint16_t type)
{
	if (session->question == 0)
		return true;
	reject(session, type, -EPROTO, "a question before the last one's answer was read");
	return false;
}

static void on_question(struct session *session, const struct wire_header *question)
{
	struct why why;
	int r;

	if (!may_ask(session, question->type))
		return;
	r = session->calls->answer(session->calls_arg, session, question, &session->text, &why);
	if (r < 0) {
		send_error(session, r, question->type, 0, &why);
		return;
	}
	session->question = question->type;
	session->text_bytes = strlen(session->text);
	session->text_sent = 0;
	session->calls->active(session->calls_arg);
	pump(session);
}

static void on_status(struct session *session, const struct wire_status *status)
{
	if (status->what != WIRE_STATUS_NODES) {
		on_question(session, &status->header);
		return;
	}
	if (!may_ask(session, WIRE_STATUS))
		return;
	session->question = WIRE_STATUS;
	session->nodes_store = status->store;
	session->nodes_first = status->first;
	pump(session);
}

/* ---- leases ---- */

static void recall(struct session *session, uint64_t now_ns)
{
	if (session->recalled_ns == 0) {
		session->recalled_ns = now_ns;
		session->recalled_gave = session->visible.given_up_count;
	}
	session->asked_ns = now_ns;
	session->recall_owed = true;
}

/* The client has spoken.  That is an answer if it holds on to nothing, or has given some of it back. */
static void lease_heard(struct session *session)
{
	const struct visible *visible = &session->visible;

	if (visible->revoked_count == 0 || visible->given_up_count != session->recalled_gave)
		session->recalled_ns = 0;
}

/* Asks at once where nothing that the client says by itself can be waited for. */
static void lease_tell(struct session *session, uint64_t now_ns)
{
	const struct visible *visible = &session->visible;

	if (visible->revoked_count == visible->unsure_count || session->recall_owed)
		return;
	/* What it says may have been on its way when it was asked: then it is asked again. */
	if (session->recalled_ns > 0 && session->heard_ns < session->asked_ns)
		return;
	if (now_ns > session->heard_ns + RECALL_SILENCE_MS * NS_PER_MS)
		recall(session, now_ns);
}

static void lease_tick(struct session *session, uint64_t now_ns)
{
	const struct visible *visible = &session->visible;

	if (visible->held_count == 0 ||
	    (visible->revoked_count == 0 && !room_is_tight(session->room))) {
		session->recalled_ns = 0;
		return;
	}
	if (session->recalled_ns == 0) {
		if (now_ns - session->heard_ns > session->lease_ns / 2)
			recall(session, now_ns);
	} else if (now_ns - session->recalled_ns > session->lease_ns) {
		connection_break(session->connection, -ECANCELED,
				 "it does not let go of what others need");
	}
}

/* ---- all messages ---- */

static void on_message(void *arg, const void *message, const int *fds, size_t fd_count)
{
	struct session *session = arg;
	enum wire_type type = ((const struct wire_header *)message)->type;

	if ((session->state == SESSION_GREETING) != (type == WIRE_HELLO)) {
		for (size_t i = 0; i < fd_count; i++)
			(void)fd_close(fds[i]);
		reject(session, (uint16_t)type, -EPROTO, "HELLO comes first, and once");
		return;
	}
	session->heard_ns = clock_now_ns();
	switch (type) {
	case WIRE_HELLO:
		on_hello(session, message);
		break;
	case WIRE_OPEN:
		on_open(session, message, fds[0]);
		break;
	case WIRE_CLOSE:
		on_close(session, message);
		break;
	case WIRE_SET:
		on_set(session, message);
		break;
	case WIRE_RETIRE:
		visible_retire(&session->visible, ((const struct wire_retire *)message)->serial);
		session->calls->active(session->calls_arg);
		break;
	case WIRE_LISTEN:
		session->events = true;
		session->visible.changed = true;
		session->event_at_ns = 0;
		session->calls->active(session->calls_arg);
		break;
	case WIRE_PREFETCH:
		on_prefetch(session, message);
		break;
	case WIRE_STATUS:
		on_status(session, message);
		break;
	case WIRE_ADMIN:
		on_question(session, message);
		break;
	case WIRE_WELCOME:
	case WIRE_OPENED:
	case WIRE_SEGMENT:
	case WIRE_SEGMENT_GONE:
	case WIRE_EVENT:
	case WIRE_NOT_NOW:
	case WIRE_TEXT:
	case WIRE_ERROR:
	case WIRE_NODES:
	case WIRE_RECALL:
		/* wire_check() lets none of these through from a client. */
		CHECK(false);
		break;
	}
	lease_heard(session);
	/* Who asks for what is there has the answer now, whatever others have to be told in this round. */
	visible_settle(&session->visible);
	pump(session);
}

/* ---- what is told in a round ---- */

static void on_writable(void *arg)
{
	pump(arg);
}

void session_retry(struct session *session)
{
	visible_retry(&session->visible);
	if (session->visible.counts[WANT_QUEUED] > 0 && !queues_has_fetch(&session->queue_entry))
		queues_add_fetch(session->queues, &session->queue_entry);
}

uint64_t session_tell(struct session *session, uint64_t now_ns, uint64_t event_pause_ns)
{
	if (session->event_at_ns <= now_ns)
		session->event_at_ns = 0;
	if (visible_wants_quiet(&session->visible) && connection_is_quiet(session->connection))
		visible_note_quiet(&session->visible);
	visible_settle(&session->visible);
	lease_tell(session, now_ns);
	pump(session);
	if (session->event_at_ns == UINT64_MAX)
		session->event_at_ns = now_ns + event_pause_ns;
	return session->events && session->visible.changed ? session->event_at_ns : UINT64_MAX;
}

void session_fill_ended(struct session *session, const struct fill_result *result)
{
	struct account *account = session->account;
	_Atomic uint64_t *bytes =
		result->prefetch ? &session->page->prefetched_bytes : &session->page->fetched_bytes;

	if (result->session == session->number && result->reason == WIRE_REASON_NONE) {
		atomic_fetch_add_explicit(bytes, result->read_bytes, memory_order_relaxed);
		*(result->prefetch ? &account->prefetched_bytes : &account->fetched_bytes) +=
			result->read_bytes;
	}
	visible_fill_ended(&session->visible, result);
}

void session_tick(struct session *session, uint64_t now_ns, uint64_t used_bytes)
{
	struct wire_session_page *page = session->page;

	/* The first means nothing beside what else is there, it only changes; the others are for people. */
	atomic_fetch_add_explicit(&page->beat, 1, memory_order_relaxed);
	atomic_store_explicit(&page->cache_bytes, session->room->cache->budget_bytes,
			      memory_order_relaxed);
	atomic_store_explicit(&page->cache_used_bytes, used_bytes, memory_order_relaxed);
	if (session->state == SESSION_GREETING &&
	    now_ns - session->born_ns > HELLO_SECONDS_MAX * NS_PER_S)
		connection_break(session->connection, -ETIMEDOUT, "it does not say HELLO");
	if (session->owed_since_ns > 0 &&
	    now_ns - session->owed_since_ns > STALL_SECONDS_MAX * NS_PER_S)
		connection_break(session->connection, -EAGAIN, "it does not read what it is sent");
	lease_tick(session, now_ns);
}

/* ---- queues ---- */

static bool queue_next(void *arg, struct queue_want *ret)
{
	struct session *session = arg;

	return visible_next(&session->visible, ret);
}

static void queue_begun(void *arg, const struct queue_want *want, int error)
{
	struct session *session = arg;

	visible_begun(&session->visible, want, error);
}

static bool queue_next_prefetch(void *arg, struct queue_want *ret)
{
	struct session *session = arg;

	for (; session->prefetch_next < session->prefetch_count; session->prefetch_next++) {
		const struct wire_entry *entry = &session->prefetch[session->prefetch_next];
		struct served *served = session->visible.attachments[entry->store]->served;
		uint32_t bytes = served->records[entry->node].payload_bytes;

		/* It is there, on its way, or cannot come. */
		if (served->nodes[entry->node].state != NODE_ABSENT)
			continue;
		if (bytes > session->prefetch_bytes || session->prefetch_left == 0)
			return false;
		*ret = (struct queue_want){ served, entry->node, 0 };
		return true;
	}
	return false;
}

static void queue_prefetch_over(void *arg)
{
	struct session *session = arg;
	const struct wire_entry *entry = &session->prefetch[session->prefetch_next++];
	const struct served *served = session->visible.attachments[entry->store]->served;

	session->prefetch_bytes -= served->records[entry->node].payload_bytes;
	session->prefetch_left--;
}

static const struct queue_calls queue_calls = {
	.next = queue_next,
	.begun = queue_begun,
	.next_prefetch = queue_next_prefetch,
	.prefetch_over = queue_prefetch_over,
};

/* ---- life ---- */

static void on_gone(void *arg, const struct why *why)
{
	struct session *session = arg;
	uint64_t unlogged_count;
	char client[16];
	const struct log_field about[] = { { "OOCD_CLIENT", client } };

	(void)snprintf(client, sizeof(client), "%d", (int)connection_pid(session->connection));
	if (why && account_may_log(session->account, clock_now_ns(), &unlogged_count)) {
		log_write_about(LOG_LEVEL_WARNING, about, ARRAY_LENGTH(about),
				"client %d (%s, uid %d): dropped: %s",
				(int)connection_pid(session->connection), session->name,
				(int)connection_uid(session->connection), why->text);
		if (unlogged_count > 0)
			log_warning("%llu lines about clients of uid %d were left out",
				    (unsigned long long)unlogged_count,
				    (int)connection_uid(session->connection));
	}
	session->calls->gone(session->calls_arg, session);
}

static const struct connection_calls connection_calls = {
	.message = on_message,
	.writable = on_writable,
	.gone = on_gone,
};

int session_create(const struct session_config *config, int socket_fd, struct session **ret,
		   struct why *why)
{
	struct session *session = calloc(1, sizeof(*session));
	int r;

	if (!session) {
		(void)fd_close(socket_fd);
		return why_errno(why, -ENOMEM, "a session");
	}
	list_init(&session->link);
	session->calls = config->calls;
	session->calls_arg = config->calls_arg;
	session->room = config->room;
	session->lease_ns = config->lease_ns;
	session->heard_ns = clock_now_ns();
	session->queues = config->queues;
	session->account = config->account;
	session->number = config->number;
	session->epoch = config->epoch;
	session->born_ns = clock_now_ns();
	queue_entry_init(&session->queue_entry, &queue_calls, session, session->number,
			 session->account);
	r = memfile_create("oocd-session", sizeof(struct wire_session_page), false,
			   &session->page_file, why);
	if (r < 0) {
		(void)fd_close(socket_fd);
		free(session);
		return r;
	}
	session->page = session->page_file.base;
	visible_init(&session->visible, config->room, config->account, config->fills,
		     config->number, session->page);
	recorder_session(session->room->cache->recorder, TRACE_BEGIN, session->number, 0);
	atomic_init(&session->page->epoch, config->epoch);
	/* A client that has just been greeted looks at it (session_tick() comes later). */
	atomic_init(&session->page->cache_bytes, config->room->cache->budget_bytes);
	r = memfile_publish(&session->page_file, MEMFILE_CHANGING, why);
	if (r < 0)
		(void)fd_close(socket_fd);
	else
		r = connection_create(config->event, socket_fd, &connection_calls, session,
				      &session->connection, why);
	if (r < 0) {
		session_destroy(session);
		return r;
	}
	connection_count_in(session->connection, &session->page->message_count);
	*ret = session;
	return 0;
}

void session_freeze(struct session *session)
{
	session->visible.frozen = true;
}

struct session *session_destroy(struct session *session)
{
	if (!session)
		return NULL;
	session->connection = connection_destroy(session->connection);
	queue_entry_done(session->queues, &session->queue_entry);
	visible_done(&session->visible);
	recorder_session(session->room->cache->recorder, TRACE_END, session->number, 0);
	atomic_store_explicit(&session->page->epoch, 0, memory_order_release);
	memfile_done(&session->page_file);
	free(session->incoming);
	free(session->prefetch);
	free(session->text);
	list_remove(&session->link);
	free(session);
	return NULL;
}
