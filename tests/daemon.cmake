# SPDX-License-Identifier: MIT
foreach(module accounts pages arena disk fetch config watchdog)
	oocd_test(test_${module} unit SOURCES unit/test_${module}.c LINK oocd_core oocd_test_helper)
endforeach()
oocd_test(test_cache unit SOURCES unit/test_cache.c LINK oocd_core oocd_test_helper SKIPS_TSAN)
oocd_test(test_queues unit SOURCES unit/test_queues.c unit/parts_kit.c
	LINK oocd_core oocd_test_helper SKIPS_TSAN)
foreach(module visible division)
	oocd_test(test_${module} unit
		SOURCES unit/test_${module}.c unit/visible_kit.c unit/parts_kit.c
		LINK oocd_core oocd_test_helper SKIPS_TSAN)
endforeach()

# The state machine with checks that a test can see fail.
oocd_test(test_node unit SOURCES unit/test_node.c ${CMAKE_SOURCE_DIR}/daemon/cache/node.c
	LINK oocd_base oocd_test_helper)
target_compile_definitions(test_node PRIVATE OOCD_UNIT_TESTING)

add_library(oocd_daemon_kit STATIC ${CMAKE_CURRENT_LIST_DIR}/integration/daemon_kit.c)
target_link_libraries(oocd_daemon_kit PUBLIC oocd_core oocd_test_helper)

oocd_test(test_daemon integration SOURCES integration/test_daemon.c LINK oocd_daemon_kit)
oocd_test(test_daemon_faults integration SOURCES integration/test_daemon_faults.c
	LINK oocd_daemon_kit)
oocd_test(test_sharing integration SOURCES integration/test_sharing.c LINK oocd_daemon_kit)
oocd_test(test_daemon_program integration SOURCES integration/test_daemon_program.c
	LINK oocd_daemon_kit)
add_dependencies(test_daemon_program oocd)

oocd_test(test_reload integration SOURCES integration/test_reload.c LINK oocd_daemon_kit)

oocd_test(test_takeover integration
	SOURCES integration/test_takeover.c integration/manager_kit.c
	LINK oocd_daemon_kit oocd_manager oocclient NEEDS oocd)

oocd_test(test_daemon_trace integration SOURCES integration/test_daemon_trace.c
	LINK oocd_daemon_kit)
oocd_test(test_openmetrics unit
	SOURCES unit/test_openmetrics.c openmetrics_judge.c LINK oocd_core oocd_test_helper)
oocd_test(test_counters integration SOURCES integration/test_counters.c openmetrics_judge.c
	LINK oocd_daemon_kit PkgConfig::JANSSON SKIPS_TSAN)

oocd_test(test_torn stress SOURCES stress/test_torn.c LINK oocd_daemon_kit SKIPS_TSAN)
oocd_test(test_churn stress SOURCES stress/test_churn.c LINK oocd_core oocd_test_helper SKIPS_TSAN)

oocd_test(test_daemon_calls fault SOURCES fault/test_daemon_calls.c LINK oocd_core oocd_test_helper)
target_link_options(test_daemon_calls PRIVATE
	-Wl,--wrap=calloc,--wrap=memfd_create,--wrap=fallocate64,--wrap=mmap64,--wrap=fchmod)

# All interleavings of a small world.  Everything that it allocates lies in a region of its own.
oocd_test(test_interleavings model
	SOURCES model/test_interleavings.c model/small_world.c model/region.c
	LINK oocd_core oocd_test_helper SKIPS_TSAN)
if(TARGET test_interleavings)
	target_link_options(test_interleavings PRIVATE
		-Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=free
		-Wl,--wrap=memfile_create,--wrap=memfile_publish,--wrap=memfile_done
		-Wl,--wrap=cache_release,--wrap=arena_give)
endif()

oocd_test(test_hostile integration SOURCES integration/test_hostile.c LINK oocd_daemon_kit)
oocd_test(test_ring unit SOURCES unit/test_ring.c LINK oocd_core oocd_test_helper PkgConfig::URING)
oocd_test(test_daemon_memory fault SOURCES fault/test_daemon_memory.c LINK oocd_daemon_kit)
target_link_options(test_daemon_memory PRIVATE
	-Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=open_memstream)
oocd_test(test_crowd stress SOURCES stress/test_crowd.c LINK oocd_test_helper
	NEEDS oocbench oocd)

# Seeded mistakes that the tests must see: all patches still apply, and the quickest is tried.
if(NOT OOCD_SANITIZE AND CMAKE_C_COMPILER_ID STREQUAL "GNU")
	add_test(NAME mutants.apply COMMAND ${CMAKE_SOURCE_DIR}/tests/mutants/run --check)
	add_test(NAME mutants.seen COMMAND ${CMAKE_SOURCE_DIR}/tests/mutants/run
		cap_off_by_one)
	set_tests_properties(mutants.apply mutants.seen PROPERTIES
		LABELS mutants TIMEOUT 300 ENVIRONMENT "BUILD=${CMAKE_BINARY_DIR}")
endif()
