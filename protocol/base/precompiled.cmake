# Most sources include the same large headers, and to read them is a quarter of a compilation. Here
# they are read once for all targets that are compiled by the same flags, as a precompiled header.

# The targets of a folder and of those below it.
function(myograde_targets_of folder result)
  get_property(targets DIRECTORY ${folder} PROPERTY BUILDSYSTEM_TARGETS)
  get_property(below DIRECTORY ${folder} PROPERTY SUBDIRECTORIES)
  foreach(each ${below})
    myograde_targets_of(${each} more)
    list(APPEND targets ${more})
  endforeach()
  set(${result} ${targets} PARENT_SCOPE)
endfunction()

set(headers <absl/status/statusor.h> <absl/strings/str_cat.h> <absl/strings/str_join.h> <absl/time/time.h>
            <algorithm> <filesystem> <fstream> <functional> <map> <memory> <optional> <set> <string>
            <thread> <vector> "${CMAKE_SOURCE_DIR}/protocol/base/json_templates.h")
set(headers_of_tests <gmock/gmock.h> <gtest/gtest.h> <rapidcheck/gtest.h>)

myograde_targets_of(${CMAKE_SOURCE_DIR} targets)
foreach(target ${targets})
  foreach(property TYPE SOURCES LINK_LIBRARIES COMPILE_OPTIONS POSITION_INDEPENDENT_CODE)
    get_target_property(${property} ${target} ${property})
  endforeach()
  if(NOT TYPE MATCHES "^(STATIC_LIBRARY|EXECUTABLE)$" OR NOT "myograde_options" IN_LIST LINK_LIBRARIES OR
     NOT SOURCES MATCHES "\\.cc" OR target STREQUAL "myograde_json")
    continue()
  endif()
  # Where most is compiled by -O0, of all copies of a standard string the linker takes the first: the
  # parser's, which is optimized.
  if(MYOGRADE_SANITIZE AND TYPE STREQUAL "EXECUTABLE")
    target_link_libraries(${target} PRIVATE myograde_json)
    target_link_options(${target} PRIVATE $<TARGET_OBJECTS:myograde_json>)
  endif()
  string(REGEX MATCH "GTest" test "${LINK_LIBRARIES}")
  string(MD5 flags "${TYPE} ${POSITION_INDEPENDENT_CODE} ${COMPILE_OPTIONS} ${test}")
  list(APPEND groups ${flags})
  list(APPEND targets_${flags} ${target})
  set(test_${flags} ${test})
endforeach()

# The first of each group makes the header, and the others take it. For fewer it would not pay.
list(REMOVE_DUPLICATES groups)
foreach(flags ${groups})
  list(POP_FRONT targets_${flags} first)
  list(LENGTH targets_${flags} others)
  if(others LESS 2)
    continue()
  endif()
  target_precompile_headers(${first} PRIVATE ${headers})
  if(test_${flags})
    target_precompile_headers(${first} PRIVATE ${headers_of_tests})
  endif()
  foreach(target ${targets_${flags}})
    target_precompile_headers(${target} REUSE_FROM ${first})
  endforeach()
  foreach(target ${first} ${targets_${flags}})
    target_link_libraries(${target} PRIVATE myograde_json)
  endforeach()
endforeach()
