// SPDX-License-Identifier: MIT
// A query counts what passes; there is nothing to say.
void main()
{
}
