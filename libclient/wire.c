/* SPDX-License-Identifier: MIT */
#include "libclient/wire.h"

#include <errno.h>
#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"

/* What is true of every message of a type, before its fields are looked at. */
struct wire_rule {
	const char *name;
	enum wire_side side;
	uint16_t body_bytes; /* of the fixed part, header included */
	uint8_t element_bytes;
	uint8_t fd_count;
};

static const struct wire_rule wire_rules[] = {
	[WIRE_HELLO] = { "HELLO", WIRE_FROM_CLIENT, sizeof(struct wire_hello), 0, 0 },
	[WIRE_OPEN] = { "OPEN", WIRE_FROM_CLIENT, sizeof(struct wire_open), 0, 1 },
	[WIRE_CLOSE] = { "CLOSE", WIRE_FROM_CLIENT, sizeof(struct wire_close), 0, 0 },
	[WIRE_SET] = { "SET", WIRE_FROM_CLIENT, sizeof(struct wire_set), sizeof(struct wire_entry),
		       0 },
	[WIRE_RETIRE] = { "RETIRE", WIRE_FROM_CLIENT, sizeof(struct wire_retire), 0, 0 },
	[WIRE_PREFETCH] = { "PREFETCH", WIRE_FROM_CLIENT, sizeof(struct wire_prefetch),
			    sizeof(struct wire_entry), 0 },
	[WIRE_STATUS] = { "STATUS", WIRE_FROM_CLIENT, sizeof(struct wire_status), 0, 0 },
	[WIRE_ADMIN] = { "ADMIN", WIRE_FROM_CLIENT, sizeof(struct wire_admin), sizeof(uint32_t),
			 0 },
	[WIRE_LISTEN] = { "LISTEN", WIRE_FROM_CLIENT, sizeof(struct wire_listen), 0, 0 },
	[WIRE_WELCOME] = { "WELCOME", WIRE_FROM_DAEMON, sizeof(struct wire_welcome), 0, 1 },
	[WIRE_OPENED] = { "OPENED", WIRE_FROM_DAEMON, sizeof(struct wire_opened), 0, 3 },
	[WIRE_SEGMENT] = { "SEGMENT", WIRE_FROM_DAEMON, sizeof(struct wire_segment), 0, 1 },
	[WIRE_SEGMENT_GONE] = { "SEGMENT_GONE", WIRE_FROM_DAEMON, sizeof(struct wire_segment_gone),
				0, 0 },
	[WIRE_EVENT] = { "EVENT", WIRE_FROM_DAEMON, sizeof(struct wire_event), 0, 0 },
	[WIRE_NOT_NOW] = { "NOT_NOW", WIRE_FROM_DAEMON, sizeof(struct wire_not_now),
			   sizeof(struct wire_refusal), 0 },
	[WIRE_TEXT] = { "TEXT", WIRE_FROM_DAEMON, sizeof(struct wire_text), 1, 0 },
	[WIRE_ERROR] = { "ERROR", WIRE_FROM_DAEMON, sizeof(struct wire_error), 0, 0 },
	[WIRE_NODES] = { "NODES", WIRE_FROM_DAEMON, sizeof(struct wire_nodes),
			 sizeof(struct wire_node), 0 },
	[WIRE_RECALL] = { "RECALL", WIRE_FROM_DAEMON, sizeof(struct wire_recall), 0, 0 },
};

/* The part of a HELLO that no version may change: header, version and a reserved word. */
#define WIRE_HELLO_HEAD_BYTES offsetof(struct wire_hello, name)

static const struct wire_rule *wire_rule_find(uint16_t type)
{
	if (type >= ARRAY_LENGTH(wire_rules) || !wire_rules[type].name)
		return NULL;
	return &wire_rules[type];
}

const char *wire_type_name(uint16_t type)
{
	const struct wire_rule *rule = wire_rule_find(type);

	return rule ? rule->name : "a message of unknown type";
}

void wire_header_init(struct wire_header *header, enum wire_type type, size_t bytes)
{
	*header = (struct wire_header){ .type = (uint16_t)type, .bytes = (uint32_t)bytes };
}

/* A text fills its field with NULs: nothing of the sender's memory leaks out behind it. */
static bool text_is_padded(const char *text, size_t field_bytes)
{
	size_t length = strnlen(text, field_bytes);

	return length < field_bytes && bytes_are_zero(text + length, field_bytes - length);
}

static bool entries_are_sound(const struct wire_entry *entries, uint32_t entry_count)
{
	float importance_max = FLT_MAX;

	for (uint32_t i = 0; i < entry_count; i++) {
		/* Both comparisons are false for a NaN. */
		if (!(entries[i].importance >= 0.0f) || !(entries[i].importance <= importance_max))
			return false;
		if (entries[i].store >= WIRE_STORE_COUNT_MAX)
			return false;
		importance_max = entries[i].importance;
	}
	return true;
}

static bool refusals_are_sound(const struct wire_refusal *refusals, uint32_t refusal_count)
{
	for (uint32_t i = 0; i < refusal_count; i++) {
		if (refusals[i].store >= WIRE_STORE_COUNT_MAX)
			return false;
		if (refusals[i].reason == WIRE_REASON_NONE ||
		    refusals[i].reason >= WIRE_REASON_COUNT_)
			return false;
	}
	return true;
}

static bool nodes_are_sound(const struct wire_nodes *nodes)
{
	if (nodes->store >= WIRE_STORE_COUNT_MAX || nodes->reserved != 0 ||
	    nodes->entry_count > WIRE_NODES_ENTRY_COUNT_MAX)
		return false;
	for (uint32_t i = 0; i < nodes->entry_count; i++)
		if (nodes->entries[i].cached >= WIRE_CACHED_COUNT_ ||
		    (nodes->entries[i].flags & ~(uint32_t)WIRE_NODE_FLAGS_ALL) != 0)
			return false;
	return true;
}

static bool status_is_sound(const struct wire_status *status)
{
	bool of_nodes = status->what == WIRE_STATUS_NODES;

	return status->what > 0 && status->what < WIRE_STATUS_COUNT_ && status->reserved == 0 &&
	       (of_nodes ? status->store < WIRE_STORE_COUNT_MAX
			 : status->store == 0 && status->first == 0);
}

static bool admin_is_sound(const struct wire_admin *admin)
{
	if (admin->reserved != 0)
		return false;
	switch (admin->what) {
	case WIRE_ADMIN_EVICT:
	case WIRE_ADMIN_UNPIN:
		if (admin->store == WIRE_STORE_ALL)
			return admin->node_count == 0;
		return admin->store < WIRE_STORE_COUNT_MAX;
	case WIRE_ADMIN_PIN:
		return admin->store < WIRE_STORE_COUNT_MAX;
	case WIRE_ADMIN_RELOAD:
		return admin->store == 0 && admin->node_count == 0;
	default:
		return false;
	}
}

/* How many elements the message says it has; they must fill it exactly. */
static uint32_t element_count(const void *message, uint16_t type)
{
	switch (type) {
	case WIRE_SET:
		return ((const struct wire_set *)message)->entry_count;
	case WIRE_PREFETCH:
		return ((const struct wire_prefetch *)message)->entry_count;
	case WIRE_ADMIN:
		return ((const struct wire_admin *)message)->node_count;
	case WIRE_NODES:
		return ((const struct wire_nodes *)message)->entry_count;
	case WIRE_NOT_NOW:
		return ((const struct wire_not_now *)message)->entry_count;
	case WIRE_TEXT:
		return ((const struct wire_text *)message)->text_bytes;
	default:
		return 0;
	}
}

static bool client_message_is_sound(const void *message, uint16_t type)
{
	const struct wire_hello *hello = message;
	const struct wire_open *open = message;
	const struct wire_close *close = message;
	const struct wire_set *set = message;
	const struct wire_prefetch *prefetch = message;

	switch (type) {
	case WIRE_HELLO:
		return hello->reserved == 0 && text_is_padded(hello->name, sizeof(hello->name));
	case WIRE_OPEN:
		return open->store < WIRE_STORE_COUNT_MAX && open->reserved == 0 &&
		       text_is_padded(open->path, sizeof(open->path));
	case WIRE_CLOSE:
		return close->store < WIRE_STORE_COUNT_MAX && close->reserved == 0;
	case WIRE_SET:
		return set->serial > 0 && (set->flags & ~(uint32_t)WIRE_SET_FLAGS_ALL) == 0 &&
		       entries_are_sound(set->entries, set->entry_count);
	case WIRE_PREFETCH:
		return prefetch->reserved == 0 &&
		       entries_are_sound(prefetch->entries, prefetch->entry_count);
	case WIRE_STATUS:
		return status_is_sound(message);
	case WIRE_ADMIN:
		return admin_is_sound(message);
	default:
		return true;
	}
}

static bool daemon_message_is_sound(const void *message, uint16_t type)
{
	const struct wire_welcome *welcome = message;
	const struct wire_opened *opened = message;
	const struct wire_segment *segment = message;
	const struct wire_segment_gone *gone = message;
	const struct wire_event *event = message;
	const struct wire_not_now *not_now = message;
	const struct wire_text *text = message;
	const struct wire_error *error = message;

	switch (type) {
	case WIRE_WELCOME:
		return welcome->epoch != 0 &&
		       welcome->page_bytes >= sizeof(struct wire_session_page);
	case WIRE_OPENED:
		return opened->store < WIRE_STORE_COUNT_MAX &&
		       opened->segment_bytes_log2 >= WIRE_SEGMENT_LOG2_MIN &&
		       opened->segment_bytes_log2 <= WIRE_SEGMENT_LOG2_MAX;
	case WIRE_SEGMENT:
		return segment->store < WIRE_STORE_COUNT_MAX &&
		       segment->segment < WIRE_SEGMENT_COUNT_MAX;
	case WIRE_SEGMENT_GONE:
		return gone->store < WIRE_STORE_COUNT_MAX && gone->segment < WIRE_SEGMENT_COUNT_MAX;
	case WIRE_EVENT:
		return event->settled <= 1 && event->complete <= event->settled;
	case WIRE_NOT_NOW:
		return not_now->reserved == 0 &&
		       refusals_are_sound(not_now->entries, not_now->entry_count);
	case WIRE_TEXT:
		return text->last <= 1;
	case WIRE_NODES:
		return nodes_are_sound(message);
	case WIRE_ERROR:
		return error->error < 0 && error->error >= -4095 &&
		       text_is_padded(error->text, sizeof(error->text));
	default:
		return true;
	}
}

int wire_check(enum wire_side side, const void *message, size_t message_bytes, size_t fd_count,
	       struct why *why)
{
	const struct wire_header *header = message;
	const struct wire_rule *rule;
	bool sound;

	if (message_bytes > WIRE_MESSAGE_BYTES_MAX)
		return why_set(why, -EMSGSIZE, "a message of %zu bytes, %u are allowed",
			       message_bytes, WIRE_MESSAGE_BYTES_MAX);
	if (message_bytes < sizeof(*header) || header->bytes != message_bytes ||
	    header->reserved != 0)
		return why_set(why, -EPROTO, "%zu bytes that do not begin with a header for them",
			       message_bytes);
	rule = wire_rule_find(header->type);
	if (!rule || rule->side != side)
		return why_set(why, -EPROTO, "a message of type %u, which is none of this side's",
			       header->type);
	if (fd_count != rule->fd_count)
		return why_set(why, -EPROTO, "%s with %zu descriptors instead of %u", rule->name,
			       fd_count, rule->fd_count);
	if (header->type == WIRE_HELLO && message_bytes >= WIRE_HELLO_HEAD_BYTES &&
	    ((const struct wire_hello *)message)->version != WIRE_VERSION)
		return 0;
	if (message_bytes < rule->body_bytes ||
	    message_bytes - rule->body_bytes !=
		    (uint64_t)element_count(message, header->type) * rule->element_bytes)
		return why_set(why, -EPROTO, "%s of %zu bytes, which is not its length", rule->name,
			       message_bytes);
	sound = side == WIRE_FROM_CLIENT ? client_message_is_sound(message, header->type)
					 : daemon_message_is_sound(message, header->type);
	return sound ? 0 : why_set(why, -EPROTO, "%s with a field that cannot be", rule->name);
}

/* Room for one descriptor more than is ever sent, so that too many are noticed. */
union wire_control {
	struct cmsghdr header; /* for its alignment */
	char bytes[CMSG_SPACE(sizeof(int) * (WIRE_FD_COUNT_MAX + 1))];
};

int wire_send(int socket_fd, const void *message, size_t message_bytes, const int *fds,
	      size_t fd_count)
{
	/* sendmsg() writes to neither; the type has no const. */
	struct iovec vector = { .iov_base = (void *)(uintptr_t)message, .iov_len = message_bytes };
	struct msghdr envelope = { .msg_iov = &vector, .msg_iovlen = 1 };
	union wire_control control = { 0 };
	ssize_t n;

	if (fd_count > WIRE_FD_COUNT_MAX)
		return -EINVAL;
	if (fd_count > 0) {
		envelope.msg_control = control.bytes;
		envelope.msg_controllen = CMSG_SPACE(sizeof(int) * fd_count);
		control.header.cmsg_level = SOL_SOCKET;
		control.header.cmsg_type = SCM_RIGHTS;
		control.header.cmsg_len = CMSG_LEN(sizeof(int) * fd_count);
		memcpy(CMSG_DATA(&control.header), fds, sizeof(int) * fd_count);
	}
	do
		n = sendmsg(socket_fd, &envelope, MSG_NOSIGNAL | MSG_DONTWAIT);
	while (n < 0 && errno == EINTR);
	if (n < 0)
		return -errno;
	/* A datagram goes whole or not at all. */
	return (size_t)n == message_bytes ? 0 : -EIO;
}

/* Takes every descriptor out of an envelope, so that none can be forgotten open. */
static size_t take_fds(struct msghdr *envelope, int *ret_fds, size_t fd_count_max)
{
	size_t fd_count = 0;

	for (struct cmsghdr *control = CMSG_FIRSTHDR(envelope); control;
	     control = CMSG_NXTHDR(envelope, control)) {
		size_t count;

		if (control->cmsg_level != SOL_SOCKET || control->cmsg_type != SCM_RIGHTS)
			continue;
		count = (control->cmsg_len - CMSG_LEN(0)) / sizeof(int);
		for (size_t i = 0; i < count; i++) {
			int fd;

			memcpy(&fd, CMSG_DATA(control) + i * sizeof(int), sizeof(fd));
			if (fd_count < fd_count_max)
				ret_fds[fd_count++] = fd;
			else
				(void)fd_close(fd);
		}
	}
	return fd_count;
}

int wire_receive(int socket_fd, void *message, int *ret_fds, size_t *ret_fd_count)
{
	struct iovec vector = { .iov_base = message, .iov_len = WIRE_MESSAGE_BYTES_MAX };
	union wire_control control = { 0 };
	struct msghdr envelope = {
		.msg_iov = &vector,
		.msg_iovlen = 1,
		.msg_control = control.bytes,
		.msg_controllen = sizeof(control.bytes),
	};
	int fds[WIRE_FD_COUNT_MAX + 1];
	size_t fd_count;
	ssize_t n;
	int r;

	do
		n = recvmsg(socket_fd, &envelope, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
	while (n < 0 && errno == EINTR);
	/* A peer that leaves with our messages unread resets the connection: gone all the same. */
	if (n < 0)
		return errno == ECONNRESET ? 0 : -errno;

	fd_count = take_fds(&envelope, fds, ARRAY_LENGTH(fds));
	r = (int)n;
	if (envelope.msg_flags & MSG_TRUNC)
		r = -EMSGSIZE;
	else if ((envelope.msg_flags & MSG_CTRUNC) || fd_count > WIRE_FD_COUNT_MAX)
		r = -EPROTO;
	if (r <= 0) {
		for (size_t i = 0; i < fd_count; i++)
			(void)fd_close(fds[i]);
		return r;
	}
	memcpy(ret_fds, fds, sizeof(int) * fd_count);
	*ret_fd_count = fd_count;
	return r;
}

static int path_print(char *ret_path, size_t path_bytes, const char *folder, const char *name)
{
	int length = snprintf(ret_path, path_bytes, "%s%s", folder, name);

	/* An address has room for so many bytes, whatever the caller has. */
	if (length < 0 || (size_t)length >= path_bytes ||
	    (size_t)length >= sizeof(((struct sockaddr_un *)NULL)->sun_path))
		return -ENAMETOOLONG;
	return 0;
}

int wire_user_socket_path(char *ret_path, size_t path_bytes)
{
	const char *runtime_folder = getenv("XDG_RUNTIME_DIR");
	char folder[64];

	if (runtime_folder && runtime_folder[0] == '/')
		return path_print(ret_path, path_bytes, runtime_folder, "/oocd.sock");
	(void)snprintf(folder, sizeof(folder), "/tmp/oocd-%u", (unsigned)geteuid());
	return path_print(ret_path, path_bytes, folder, "/oocd.sock");
}

int wire_socket_path(const char *given, char *ret_path, size_t path_bytes)
{
	const char *wanted = getenv("OOCD_SOCKET");

	if (given)
		return path_print(ret_path, path_bytes, given, "");
	if (wanted && wanted[0])
		return path_print(ret_path, path_bytes, wanted, "");
	if (access(WIRE_SYSTEM_SOCKET, F_OK) == 0)
		return path_print(ret_path, path_bytes, WIRE_SYSTEM_SOCKET, "");
	return wire_user_socket_path(ret_path, path_bytes);
}
