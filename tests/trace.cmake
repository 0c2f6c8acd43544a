# SPDX-License-Identifier: MIT
oocd_test(test_trace unit SOURCES unit/test_trace.c LINK oocd_trace oocd_test_helper)
oocd_fuzz(fuzz_trace LINK oocd_trace)
oocd_test(test_replacement unit SOURCES unit/test_replacement.c LINK oocd_core oocd_test_helper)
oocd_test(test_replay unit SOURCES unit/test_replay.c LINK oocd_bench oocd_test_helper SKIPS_TSAN)
oocd_test(test_golden_trace golden
	SOURCES golden/test_golden_trace.c LINK oocd_bench oocd_test_helper)
oocd_test(test_trace_programs integration
	SOURCES integration/test_trace_programs.c LINK oocd_test_helper PkgConfig::JANSSON
	NEEDS oocbench oocctl)
