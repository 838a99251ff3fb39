#!/bin/sh
# Installs the system libraries that the optional outputs want: pango for the PDF, GL for the 3-D surfaces, Chromium for
# the tests of the report. Works as root on Debian and its kin; says what to do elsewhere. Never fails the build.
set -u
wanted="libpango-1.0-0 libpangoft2-1.0-0 libgl1 libegl1 libusb-1.0-0 chromium poppler-utils"
command -v dpkg-query >/dev/null 2>&1 || { echo "Not Debian: install pango, OpenGL (libGL, libEGL), libusb and Chromium for PDF, 3-D and browser tests."; exit 0; }
missing=""
for package in $wanted; do
  dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q "install ok installed" || missing="$missing $package"
done
[ -z "$missing" ] && exit 0
if [ "$(id -u)" -ne 0 ]; then
  echo "Not root: for PDF, 3-D surfaces and browser tests run once: apt-get install$missing"
  exit 0
fi
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq && apt-get install -y -qq --no-install-recommends $missing >/dev/null || echo "Could not install:$missing; what wants them says so."
exit 0
