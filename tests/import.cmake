# SPDX-License-Identifier: MIT
add_library(oocd_import_kit STATIC ${CMAKE_CURRENT_LIST_DIR}/unit/import_kit.c)
target_link_libraries(oocd_import_kit PUBLIC oocd_import oocd_test_helper PkgConfig::ZLIB)

foreach(name test_number test_source test_polygon test_join)
	oocd_test(${name} unit SOURCES unit/${name}.c LINK oocd_import_kit)
endforeach()
