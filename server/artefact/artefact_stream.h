// Carries an accepted submission's files to another host: its unpacked folder as a tar, and the tar as
// the same folder again. Names, targets of links and contents are a participant's, and are only ever
// data: every file is opened beneath the folder and through no link, on both sides. What comes out
// has the digest that identifies the submission, or nothing does.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/artefact/artefact.h"

namespace myograde::server {

using ByteSink = std::function<absl::Status(std::string_view bytes)>;
// The next bytes; "": there are no more.
using ByteSource = std::function<absl::StatusOr<std::string>()>;

// Gives the folder's tar to `sink`; the same folder gives the same bytes. `digest` is that of the
// artefact: DataLossError, once all bytes were given, if the folder's content has another. Else an
// error of the sink's, or UnavailableError: trouble of the host.
absl::Status StreamArtefact(const std::string& folder, const std::string& digest,
                            const ByteSink& sink);

// The reverse, into `folder`, which must not exist and is removed again after an error. Files and
// folders get the modes that the daemon gives them (0755 and 0644) and their times; they belong to
// the caller. DataLossError: it is broken, or the content has another digest. ResourceExhaustedError:
// the disk is full. Else an error of the source's, or UnavailableError: trouble of the host.
absl::Status PlaceStreamedArtefact(const ByteSource& source, const std::string& digest,
                                   const std::string& folder);

}  // namespace myograde::server
