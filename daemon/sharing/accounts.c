/* SPDX-License-Identifier: MIT */
#include "daemon/sharing/accounts.h"

#include <errno.h>
#include <stdlib.h>

#include "daemon/limits.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"

static struct account *account_of(struct list *link)
{
	return LIST_ENTRY(link, struct account, link);
}

static void set_policy(const struct accounts *accounts, struct account *account)
{
	uid_t uid = account->policy.uid;
	struct account_policy policy = { .uid = uid };

	for (uint32_t i = 0; i < accounts->policy_count; i++)
		if (accounts->policies[i].uid == uid)
			policy = accounts->policies[i];
	if (policy.weight == 0)
		policy.weight = ACCOUNT_WEIGHT_USUAL;
	if (policy.session_count_max == 0)
		policy.session_count_max = ACCOUNT_SESSION_COUNT_MAX;
	account->policy = policy;
}

void accounts_init(struct accounts *accounts, const struct account_policy *policies,
		   uint32_t policy_count)
{
	*accounts = (struct accounts){ .policies = policies, .policy_count = policy_count };
	list_init(&accounts->in_order);
}

void accounts_done(struct accounts *accounts)
{
	LIST_FOR_EACH (link, &accounts->in_order) {
		CHECK(account_of(link)->session_count == 0);
		list_remove(link);
		free(account_of(link));
	}
}

void accounts_set_policies(struct accounts *accounts, const struct account_policy *policies,
			   uint32_t policy_count)
{
	accounts->policies = policies;
	accounts->policy_count = policy_count;
	LIST_FOR_EACH (link, &accounts->in_order)
		set_policy(accounts, account_of(link));
}

static struct account *account_find(struct accounts *accounts, uid_t uid)
{
	LIST_FOR_EACH (link, &accounts->in_order)
		if (account_of(link)->policy.uid == uid)
			return account_of(link);
	return NULL;
}

/* The oldest of those that nobody is in go when there are too many. */
static void drop_idle(struct accounts *accounts)
{
	LIST_FOR_EACH (link, &accounts->in_order) {
		if (accounts->count < ACCOUNT_COUNT_KEPT)
			return;
		if (account_of(link)->session_count > 0)
			continue;
		list_remove(link);
		free(account_of(link));
		accounts->count--;
	}
}

int accounts_join(struct accounts *accounts, uid_t uid, struct account **ret, struct why *why)
{
	struct account *account = account_find(accounts, uid);

	if (!account) {
		drop_idle(accounts);
		account = calloc(1, sizeof(*account));
		if (!account)
			return why_errno(why, -ENOMEM, "an account");
		account->policy.uid = uid;
		set_policy(accounts, account);
		list_push_back(&accounts->in_order, &account->link);
		accounts->count++;
	}
	if (account->session_count >= account->policy.session_count_max) {
		account->refused_count++;
		*ret = account;
		return why_set(why, -EAGAIN,
			       "uid %u has %u clients connected already, as many as it may: close "
			       "one, or have its cap raised",
			       (unsigned)uid, account->session_count);
	}
	account->session_count++;
	*ret = account;
	return 0;
}

void account_leave(struct account *account)
{
	CHECK(account->session_count > 0);
	account->session_count--;
	CHECK(account->session_count > 0 ||
	      (account->held_pages == 0 && account->fetching_count == 0));
}

bool account_may_log(struct account *account, uint64_t now_ns, uint64_t *ret_unlogged)
{
	if (account->log_since_ns == 0 ||
	    now_ns - account->log_since_ns > ACCOUNT_LOG_SECONDS * NS_PER_S) {
		account->log_since_ns = now_ns;
		account->log_count = 0;
	}
	if (account->log_count == ACCOUNT_LOG_LINES_MAX) {
		account->unlogged_count++;
		return false;
	}
	account->log_count++;
	*ret_unlogged = account->unlogged_count - account->unlogged_told_count;
	account->unlogged_told_count = account->unlogged_count;
	return true;
}

void accounts_check(const struct accounts *accounts)
{
	uint32_t count = 0;

	LIST_FOR_EACH (link, &accounts->in_order) {
		const struct account *account = account_of(link);

		CHECK(account->fetching_count <= account->session_count);
		CHECK(account->session_count > 0 || account->held_pages == 0);
		count++;
	}
	CHECK(count == accounts->count);
}
