# Run by CPack on what it packs, before it packs it: everybody may read it, and run what its owner may
# run, whatever umask it was built with. A package with a closed /usr/lib would close the host's.
file(GLOB trees ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/*)
execute_process(COMMAND chmod -R u=rwX,go=rX ${trees} COMMAND_ERROR_IS_FATAL ANY)
