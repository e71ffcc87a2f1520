// SPDX-License-Identifier: Apache-2.0
// Markup as tagged templates: htm builds Preact nodes, so text is always text and never parsed as HTML.
import { h } from 'preact';
import htm from 'htm';

export const html = htm.bind(h);
