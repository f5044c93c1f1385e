# The Debian packages: which files go where, and what CPack writes about them. ./dev package builds
# them; README.md here tells how they are used. Paths are those of an installation in /usr.
set(share ${CMAKE_INSTALL_DATADIR}/myograde)
set(here ${CMAKE_SOURCE_DIR}/docker/debian)
set(pages ${CMAKE_BINARY_DIR}/debian)

find_package(Python3 REQUIRED COMPONENTS Interpreter)
# Manual pages and completions are made of what the programs say themselves.
add_custom_command(
  OUTPUT ${pages}/complete.stamp
  COMMAND ${Python3_EXECUTABLE} -B ${here}/pages.py ${PROJECT_VERSION}
          ${CMAKE_RUNTIME_OUTPUT_DIRECTORY} ${CMAKE_SOURCE_DIR} ${pages}
  COMMAND ${CMAKE_COMMAND} -E touch ${pages}/complete.stamp
  DEPENDS myograde myograded ${here}/pages.py ${here}/roff.py ${CMAKE_SOURCE_DIR}/server/docs/help.py ${here}/copyright
          ${here}/myograde-setup ${CMAKE_SOURCE_DIR}/configs/server.json
          ${CMAKE_SOURCE_DIR}/configs/README.md ${CMAKE_SOURCE_DIR}/configs/challenges/README.md
          ${CMAKE_SOURCE_DIR}/configs/sandbox/policy.json
          ${CMAKE_SOURCE_DIR}/configs/sandbox/sim.json
          ${CMAKE_SOURCE_DIR}/server/artefact/README.md ${CMAKE_SOURCE_DIR}/CHANGELOG.md
  VERBATIM)
add_custom_target(myograde_debian DEPENDS ${pages}/complete.stamp myograde myograded
                  myograde-runner myograde-node myograde-sim myograde-bridge myograde-render
                  myograde-unpack myograde_policies)

# None of these is part of an installation by cmake --install without a component.
# CMake wants the component right after the destination.
function(debian component)
  set(words ${ARGN})
  list(FIND words DESTINATION at)
  if(at LESS 0)
    list(LENGTH words at)
  else()
    math(EXPR at "${at} + 2")
  endif()
  list(LENGTH words length)
  if(at EQUAL length)
    list(APPEND words COMPONENT ${component} EXCLUDE_FROM_ALL)
  else()
    list(INSERT words ${at} COMPONENT ${component} EXCLUDE_FROM_ALL)
  endif()
  install(${words})
endfunction()

install(TARGETS myograde RUNTIME DESTINATION bin COMPONENT client EXCLUDE_FROM_ALL)
debian(client DIRECTORY configs/tracks DESTINATION /etc/myograde)
debian(client DIRECTORY server/figures/ DESTINATION ${share}/figures
       FILES_MATCHING PATTERN "*.py" PATTERN __pycache__ EXCLUDE)
debian(client DIRECTORY ${CMAKE_BINARY_DIR}/policies/starter DESTINATION ${share}/policies
       USE_SOURCE_PERMISSIONS PATTERN "*.stamp" EXCLUDE)
debian(client DIRECTORY ${pages}/man1 DESTINATION share/man)
# The bill of materials and licences that ./dev sbom writes.
debian(client DIRECTORY ${CMAKE_BINARY_DIR}/third-party DESTINATION share/doc/myograde-client
       OPTIONAL)
debian(client FILES ${pages}/completion/bash DESTINATION share/bash-completion/completions
       RENAME myograde)
debian(client FILES ${pages}/completion/zsh DESTINATION share/zsh/vendor-completions
       RENAME _myograde)
debian(client FILES ${pages}/completion/fish DESTINATION share/fish/vendor_completions.d
       RENAME myograde.fish)

install(TARGETS myograded myograde-runner myograde-node myograde-sim myograde-bridge myograde-render
                myograde-unpack
        RUNTIME DESTINATION libexec/myograde COMPONENT server EXCLUDE_FROM_ALL)
debian(server PROGRAMS ${here}/myograde-setup DESTINATION sbin)
debian(server FILES ${CMAKE_SOURCE_DIR}/policies/python/myograde/models.py docker/wheels.txt
       DESTINATION ${share}/setup)
debian(server FILES configs/server.json DESTINATION /etc/myograde)
debian(server DIRECTORY configs/sandbox DESTINATION /etc/myograde)
debian(server DIRECTORY DESTINATION /etc/myograde/challenges)
debian(server DIRECTORY configs/reference configs/schema DESTINATION ${share})
debian(server DIRECTORY configs/operations DESTINATION ${share})
debian(server DIRECTORY server/runtime/make/ DESTINATION ${share}/runtime
       PATTERN __pycache__ EXCLUDE)
debian(server DIRECTORY policies/runtimes DESTINATION ${share})
debian(server DIRECTORY ${CMAKE_BINARY_DIR}/docs DESTINATION ${share} OPTIONAL)
debian(server DIRECTORY ${CMAKE_BINARY_DIR}/adapters DESTINATION ${share}
       PATTERN "*.stamp" EXCLUDE PATTERN __pycache__ EXCLUDE)
foreach(policy scripted-elbow baseline-manipulation baseline-locomotion baseline-baoding
        baseline-chasetag baseline-reorientation baseline-relocation)
  set(folder lib/myograde/policies/${policy})
  install(TARGETS policy_${policy} RUNTIME DESTINATION ${folder} COMPONENT server EXCLUDE_FROM_ALL)
  debian(server DIRECTORY ${CMAKE_BINARY_DIR}/policies/${policy}/ DESTINATION ${folder}
         FILES_MATCHING PATTERN "*.json")
endforeach()
debian(server FILES ${CMAKE_BINARY_DIR}/openapi.json DESTINATION ${share})
set(units ${here}/systemd)
debian(server FILES ${units}/myograded.service ${units}/myograded.socket
       ${units}/myograded-https.socket DESTINATION /lib/systemd/system)
debian(server FILES ${units}/root.conf ${units}/network.conf DESTINATION ${share}/systemd)
debian(server FILES ${here}/sysusers.conf DESTINATION lib/sysusers.d RENAME myograde.conf)
debian(server FILES ${here}/tmpfiles.conf DESTINATION lib/tmpfiles.d RENAME myograde.conf)
debian(server FILES ${here}/logrotate DESTINATION /etc/logrotate.d RENAME myograde)
debian(server DIRECTORY ${pages}/man5 ${pages}/man8 DESTINATION share/man)
debian(server FILES server/daemon/OPERATIONS.md ${here}/README.md
       DESTINATION share/doc/myograde-server)
# The programs look for configs in share; an administrator looks in /etc.
install(CODE "
  set(etc \"\$ENV{DESTDIR}/etc/myograde\")
  foreach(part reference schema)
    file(CREATE_LINK /usr/share/myograde/\${part} \${etc}/\${part} SYMBOLIC)
  endforeach()
  set(doc \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/share/doc/myograde-server\")
  file(MAKE_DIRECTORY \${doc})
  file(CREATE_LINK ../myograde-client/third-party \${doc}/third-party SYMBOLIC)"
  COMPONENT server EXCLUDE_FROM_ALL)
install(CODE "
  set(root \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/share/myograde\")
  file(MAKE_DIRECTORY \${root})
  file(CREATE_LINK /etc/myograde \${root}/configs SYMBOLIC)"
  COMPONENT client EXCLUDE_FROM_ALL)

set(python_dir lib/python3/dist-packages)
debian(python DIRECTORY ${CMAKE_BINARY_DIR}/python/myograde DESTINATION ${python_dir}
       PATTERN __pycache__ EXCLUDE PATTERN "*.so" EXCLUDE PATTERN "*.stamp" EXCLUDE)

debian(python FILES ${units}/myograde-connect@.service DESTINATION /lib/systemd/system)

set(package_client myograde-client)
set(package_server myograde-server)
set(package_policy-kit libmyograde-policy-dev)
set(package_python python3-myograde)
foreach(component client server policy-kit python)
  # The pages are there once myograde_debian is built: the kit is also installed without them.
  debian(${component} FILES ${here}/copyright ${pages}/changelog.gz ${pages}/NEWS.gz
         DESTINATION share/doc/${package_${component}} OPTIONAL)
  if(EXISTS ${here}/lintian/${package_${component}})
    debian(${component} FILES ${here}/lintian/${package_${component}}
           DESTINATION share/lintian/overrides)
  endif()
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_COMPONENTS_ALL client server policy-kit python)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_SET_DESTDIR ON)
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PACKAGE_NAME myograde)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "MyoGrade maintainers <maintainers@myograde.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_FILE ${here}/description.txt)
set(CPACK_PRE_BUILD_SCRIPTS ${here}/open_permissions.cmake)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

function(describe component summary)
  string(TOUPPER ${component} upper)
  string(JOIN "\n" more ${ARGN})
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${package_${component}} PARENT_SCOPE)
  set(CPACK_COMPONENT_${upper}_DESCRIPTION "${summary}\n${more}" PARENT_SCOPE)
endfunction()
describe(client "command line client of the MyoGrade evaluation server"
         "Submits policies for the tracks of MyoChallenge, and shows results.")
describe(server "evaluation server for policies on the tracks of MyoChallenge"
         "Plays submitted policies in sandboxes and ranks them. The physics library"
         "and the models are fetched by myograde-setup, as they are no part of it.")
describe(policy-kit "C++ kit for policies that MyoGrade grades"
         "Headers, static library and message types for programs that answer over LCM.")
describe(python "Python kit and client of the MyoGrade evaluation server"
         "Policies as classes with two methods, and a client for results.")
set(CPACK_DEBIAN_CLIENT_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_CLIENT_PACKAGE_SUGGESTS "myograde-server, python3-matplotlib")
set(CPACK_DEBIAN_SERVER_PACKAGE_SHLIBDEPS ON)
# The physics library is no package's: myograde-setup fetches it.
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${MYOGRADE_CACHE}/mujoco-2.2.2/lib)
set(CPACK_DEBIAN_SERVER_PACKAGE_DEPENDS
    "myograde-client (= ${PROJECT_VERSION}), adduser, bubblewrap, ca-certificates, iproute2, python3, python3-pip, python3-venv")
set(CPACK_DEBIAN_SERVER_PACKAGE_RECOMMENDS "systemd, logrotate")
# Pictures and films of episodes; they bring a compiler of shaders and a hundred codecs.
set(CPACK_DEBIAN_SERVER_PACKAGE_SUGGESTS "libosmesa6, ffmpeg")
set(CPACK_DEBIAN_POLICY-KIT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_POLICY-KIT_PACKAGE_DEPENDS "liblcm-dev, libglib2.0-dev")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3")
set(CPACK_DEBIAN_CLIENT_PACKAGE_CONTROL_EXTRA ${pages}/control/client/conffiles)
set(CPACK_DEBIAN_SERVER_PACKAGE_CONTROL_EXTRA
    "${pages}/control/server/conffiles;${here}/control/postinst;${here}/control/prerm;${here}/control/postrm")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
    "${here}/control/python/postinst;${here}/control/python/prerm;${here}/control/python/postrm")
include(CPack)
