/* SPDX-License-Identifier: MIT */
#include "daemon/sharing/debts.h"

void debts_add(struct debts *debts, uint32_t session)
{
	for (uint32_t i = 0; i < debts->count; i++) {
		if (debts->debts[i].session == session) {
			debts->debts[i].nodes++;
			return;
		}
	}
	if (debts->count == DEBT_COUNT_MAX)
		debts->others++;
	else
		debts->debts[debts->count++] = (struct debt){ session, 1 };
}
