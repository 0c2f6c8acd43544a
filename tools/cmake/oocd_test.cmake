# SPDX-License-Identifier: MIT
# oocd_test(NAME LABEL SOURCES src... LINK lib... [ARGS arg...] [TIMEOUT s] [NEEDS target...]
#           [SKIPS_TSAN])
# SKIPS_TSAN: long, and without a thread of ours that shorter tests do not have, so that
# ThreadSanitizer has nothing to find in it (Mesa's threads are not built with it, and would be
# misjudged).
# One cmocka program and its ctest "LABEL.NAME".  A skip (exit status 77) says why on its last line.
function(oocd_test name label)
	cmake_parse_arguments(T "SKIPS_TSAN" "TIMEOUT" "SOURCES;LINK;ARGS;NEEDS" ${ARGN})
	if(T_SKIPS_TSAN AND OOCD_SANITIZE STREQUAL "thread")
		return()
	endif()
	if(NOT T_TIMEOUT)
		set(T_TIMEOUT 60)
	endif()
	if(OOCD_SANITIZE)
		math(EXPR T_TIMEOUT "${T_TIMEOUT} * 5")
	endif()
	add_executable(${name} ${T_SOURCES})
	target_link_libraries(${name} PRIVATE oocd_flags PkgConfig::CMOCKA ${T_LINK})
	if(T_NEEDS)
		add_dependencies(${name} ${T_NEEDS})
	endif()
	set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
	add_test(NAME ${label}.${name} COMMAND ${name} ${T_ARGS})
	set_tests_properties(${label}.${name} PROPERTIES
		LABELS ${label} TIMEOUT ${T_TIMEOUT} SKIP_RETURN_CODE 77
		ENVIRONMENT "OOCD_BIN=${CMAKE_BINARY_DIR}/bin;OOCD_SOURCE=${CMAKE_SOURCE_DIR}")
endfunction()
